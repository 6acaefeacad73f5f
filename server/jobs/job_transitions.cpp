#include "server/jobs/job_transitions.h"

namespace saltus::server {
namespace {

struct Row {
  JobState from;
  JobEvent event;
  JobState to;
};

using S = JobState;
using E = JobEvent;

// A job that is being cancelled ends as Cancelled whatever becomes of its worker, except when the worker won the race
// and delivered.
constexpr Row kTable[] = {
    {S::Queued, E::Start, S::Running},         {S::Queued, E::Cancel, S::Cancelled},

    {S::Queued, E::LoseInput, S::Failed},

    {S::Running, E::Succeed, S::Succeeded},    {S::Running, E::Fail, S::Failed},
    {S::Running, E::Cancel, S::Cancelling},    {S::Running, E::Lose, S::Queued},
    {S::Running, E::GiveUp, S::Failed},        {S::Running, E::Release, S::Queued},

    {S::Cancelling, E::Succeed, S::Succeeded}, {S::Cancelling, E::Fail, S::Cancelled},
    {S::Cancelling, E::Cancel, S::Cancelling}, {S::Cancelling, E::Stop, S::Cancelled},
    {S::Cancelling, E::Lose, S::Cancelled},    {S::Cancelling, E::GiveUp, S::Cancelled},
    {S::Cancelling, E::Release, S::Cancelled},

    {S::Succeeded, E::Cancel, S::Succeeded},   {S::Failed, E::Cancel, S::Failed},
    {S::Cancelled, E::Cancel, S::Cancelled},
};

}  // namespace

std::optional<JobState> next_state(JobState state, JobEvent event) {
  for (const Row& row : kTable)
    if (row.from == state && row.event == event) return row.to;
  return std::nullopt;
}

bool is_terminal(JobState state) {
  return state == JobState::Succeeded || state == JobState::Failed || state == JobState::Cancelled;
}

bool is_held(JobState state) { return state == JobState::Running || state == JobState::Cancelling; }

std::string to_string(JobState state) {
  switch (state) {
    case JobState::Queued:
      return "queued";
    case JobState::Running:
      return "running";
    case JobState::Cancelling:
      return "cancelling";
    case JobState::Succeeded:
      return "succeeded";
    case JobState::Failed:
      return "failed";
    case JobState::Cancelled:
      return "cancelled";
  }
  return "";
}

}  // namespace saltus::server
