#include "server/observe/job_history.h"

namespace saltus::server {

void JobHistory::seed(const JobRecord& job) {
  if (is_terminal(job.state)) return;
  if (open_.insert_or_assign(job.id, Known{job.state, job.attempt, job.lost_attempts}).second) ++counts_[job.state];
}

std::optional<JobStep> JobHistory::changed(const JobRecord& job) {
  const auto found = open_.find(job.id);
  if (found == open_.end()) {
    // Ended before, and told again; a new job is always queued first.
    if (is_terminal(job.state)) return std::nullopt;
    seed(job);
    return JobStep{JobStep::Kind::Queued, false};
  }
  const Known before = found->second;
  const bool has_lost = job.lost_attempts > before.lost_attempts;
  --counts_[before.state];
  if (is_terminal(job.state)) {
    open_.erase(found);
    return JobStep{JobStep::Kind::Ended, has_lost};
  }
  found->second = {job.state, job.attempt, job.lost_attempts};
  ++counts_[job.state];
  if (job.attempt != before.attempt) return JobStep{JobStep::Kind::Started, false};
  if (job.state == before.state) return std::nullopt;
  if (job.state == JobState::Cancelling) return JobStep{JobStep::Kind::Cancelling, false};
  return JobStep{JobStep::Kind::Requeued, has_lost};
}

void JobHistory::deleted(const std::string& id) {
  const auto found = open_.find(id);
  if (found == open_.end()) return;
  --counts_[found->second.state];
  open_.erase(found);
}

int JobHistory::count(JobState state) const {
  const auto found = counts_.find(state);
  return found == counts_.end() ? 0 : found->second;
}

}  // namespace saltus::server
