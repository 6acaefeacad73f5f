#include "server/observe/observation.h"

namespace saltus::server {
namespace {

std::string describe(const JobRecord& job, const JobStep& step) {
  switch (step.kind) {
    case JobStep::Kind::Queued:
      return "job is queued";
    case JobStep::Kind::Started:
      return "attempt is started";
    case JobStep::Kind::Cancelling:
      return "job is being cancelled";
    case JobStep::Kind::Requeued:
      // The reason only: the sentence may hold what the worker has said.
      return "attempt has ended without an outcome" + (job.last_loss ? " (" + job.last_loss->reason + ")" : "") +
             ", job is queued again";
    case JobStep::Kind::Ended:
      return "job has " + to_string(job.state) + (job.failure ? ": " + job.failure->reason : "");
  }
  return "";
}

}  // namespace

// Who finds a call in the numbers finds it in the audit log.
void Observation::ended(const CallRecord& call) {
  if (call.is_change) audit_.add(call);
  metrics_.call_ended(call);
}

void Observation::denied(const CallRecord& call) {
  if (call.is_change) audit_.add(call);
  metrics_.call_denied(call);
}

void Observation::count_jobs() {
  metrics_.jobs_are(history_.count(JobState::Queued), history_.count(JobState::Running),
                    history_.count(JobState::Cancelling));
}

void Observation::found(const JobRecord& job) {
  std::lock_guard lock(mutex_);
  history_.seed(job);
  count_jobs();
}

void Observation::job_changed(const JobRecord& job) {
  std::optional<JobStep> step;
  {
    std::lock_guard lock(mutex_);
    step = history_.changed(job);
    count_jobs();
  }
  if (!step) return;
  metrics_.job_stepped(job, *step);
  LogLine line(step->has_lost_attempt || job.state == JobState::Failed ? LogLine::Level::Warning : LogLine::Level::Info,
               describe(job, *step));
  line.job = job.id;
  line.attempt = job.attempt;
  line.submitter = job.submitter;
  log_(line);
}

void Observation::job_deleted(const std::string& id) {
  {
    std::lock_guard lock(mutex_);
    history_.deleted(id);
    count_jobs();
  }
  LogLine line("job is deleted");
  line.job = id;
  log_(line);
}

}  // namespace saltus::server
