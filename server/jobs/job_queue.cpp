#include "server/jobs/job_queue.h"

#include "server/jobs/input_refusal.h"
#include "server/jobs/job_transitions.h"
#include "server/jobs/refusal.h"

#include <algorithm>
#include <stdexcept>

namespace saltus::server {
namespace {

// A place becomes free when a job starts; nobody knows when.
constexpr std::chrono::milliseconds kQueueRetry{5000};

void apply(JobRecord& job, JobEvent event, WallTime now) {
  const auto next = next_state(job.state, event);
  if (!next) throw std::logic_error("job " + job.id + " cannot leave state " + to_string(job.state) + " that way");
  job.state = *next;
  if (!is_terminal(job.state)) return;
  job.ended = now;
  job.not_before.reset();
  job.checkpoint.reset();
}

Refusal job_not_found(const std::string& id) {
  return {RefusalKind::NotFound, "JOB_NOT_FOUND", "there is no job '" + id + "'; list the jobs to see which there are"};
}

/// " (batch job 17 on node3)", or what is known of that.
std::string place_of(const std::string& batch_id, const std::string& host) {
  if (batch_id.empty()) return "";
  return " (batch job " + batch_id + (host.empty() ? "" : " on " + host) + ")";
}

/// Those before the last one that a batch system had: that is where somebody would go on looking.
std::string losses_before(const JobRecord& job) {
  std::string text;
  for (const LostAttempt& lost : job.losses)
    if (lost.attempt != job.attempt && !lost.batch_id.empty())
      text += (text.empty() ? "; before it: " : ", ") + lost.reason + place_of(lost.batch_id, lost.host);
  return text;
}

bool is_same_outcome(const JobRecord& job, const Outcome& outcome) {
  if (const auto* delivered = std::get_if<Delivered>(&outcome))
    return job.state == JobState::Succeeded && job.artifacts == delivered->artifacts;
  if (const auto* failure = std::get_if<JobFailure>(&outcome))
    return job.state == JobState::Cancelled || (job.state == JobState::Failed && job.failure == *failure);
  return job.state == JobState::Cancelled;
}

void require_blobs(JobTable& table, const std::vector<Artifact>& artifacts) {
  for (const Artifact& artifact : artifacts) {
    const auto size = table.blob_size(artifact.digest);
    if (!size || *size != artifact.size)
      throw Refusal(RefusalKind::FailedPrecondition, "ARTIFACT_MISSING",
                    "artefact " + artifact.name + " is " + artifact.digest + " with " + std::to_string(artifact.size) +
                        " bytes, which has not been uploaded; upload it before completing the job");
  }
}

}  // namespace

Refusal lease_lost(const AttemptKey& key) {
  return {RefusalKind::Aborted, "LEASE_LOST",
          "attempt " + std::to_string(key.attempt) + " of job " + key.job_id +
              " is not the current one any more; the worker must end without output"};
}

std::string describe(LossCause cause, const std::string& detail) {
  switch (cause) {
    case LossCause::Crashed:
      return "the worker died by " + detail;
    case LossCause::Exited:
      return "the worker ended without a result, " + detail;
    case LossCause::Stopped:
      return "the worker stopped unasked";
    case LossCause::Vanished:
      return "the worker was gone after a restart of the daemon";
    case LossCause::LeaseExpired:
      return "the worker was not heard of for too long";
    case LossCause::Stalled:
      return "the worker was alive but stood still for " + detail;
    case LossCause::NoRoom:
      return "the daemon's disk had no room for the results";
    case LossCause::LaunchFailed:
      return "the worker could not be started: " + detail;
    case LossCause::NeverBegun:
      return "the worker that took the job was not heard of again";
    case LossCause::Released:
      return "the daemon was shut down";
    case LossCause::TimeLimit:
      return "the batch system ended the worker at its time limit";
    case LossCause::Preempted:
      return "the batch system ended the worker for the sake of others";
    case LossCause::NodeFailed:
      return "the worker's machine failed";
    case LossCause::Withdrawn:
      return "the worker was cancelled in the batch system, not by this daemon";
  }
  return detail;
}

std::string reason_of(LossCause cause) {
  switch (cause) {
    case LossCause::Crashed:
      return "WORKER_CRASHED";
    case LossCause::Exited:
      return "WORKER_EXITED";
    case LossCause::Stopped:
      return "WORKER_STOPPED";
    case LossCause::Vanished:
      return "WORKER_VANISHED";
    case LossCause::LeaseExpired:
      return "LEASE_EXPIRED";
    case LossCause::Stalled:
      return "STALLED";
    case LossCause::NoRoom:
      return "STORAGE_FULL";
    case LossCause::LaunchFailed:
      return "LAUNCH_FAILED";
    case LossCause::NeverBegun:
      return "NEVER_BEGUN";
    case LossCause::Released:
      return "DRAINING";
    case LossCause::TimeLimit:
      return "BATCH_TIME_LIMIT";
    case LossCause::Preempted:
      return "PREEMPTED";
    case LossCause::NodeFailed:
      return "NODE_FAILED";
    case LossCause::Withdrawn:
      return "BATCH_CANCELLED";
  }
  return "";
}

JobRecord require_job(JobReader& reader, const std::string& id) {
  auto job = reader.find(id);
  if (!job) throw job_not_found(id);
  return *std::move(job);
}

void require_owner(const JobRecord& job, const std::string& submitter) {
  if (job.submitter != submitter) throw job_not_found(job.id);
}

JobRecord JobQueue::submit(JobTable& table, const NewJob& asked, const std::function<void()>& require_room) const {
  if (!asked.request_id.empty()) {
    if (auto earlier = table.find_request(asked.submitter, asked.request_id)) {
      if (earlier->request_hash == asked.request_hash) return *std::move(earlier);
      throw Refusal(RefusalKind::AlreadyExists, "REQUEST_ID_REUSED",
                    "request_id '" + asked.request_id + "' was used for another registration, job " + earlier->id +
                        "; use a new request_id");
    }
  }
  if (table.count(JobState::Queued) >= limits_.max_queued)
    throw Refusal(
        RefusalKind::Exhausted, "QUEUE_FULL",
        "the queue holds " + std::to_string(limits_.max_queued) + " jobs, which is its limit; try again later",
        kQueueRetry);
  const int own_limit = limits_.max_queued_of_submitter;
  if (asked.has_quota && own_limit > 0 && table.count_queued_of(asked.submitter) >= own_limit)
    throw Refusal(RefusalKind::Exhausted, "QUOTA",
                  "'" + asked.submitter + "' has " + std::to_string(own_limit) +
                      " queued jobs, which is the limit of one submitter; try again when some have started",
                  kQueueRetry);
  require_room();
  std::vector<std::string> missing;
  for (const std::string& digest : asked.inputs)
    if (!table.blob_size(digest) && std::find(missing.begin(), missing.end(), digest) == missing.end())
      missing.push_back(digest);
  if (!missing.empty()) throw MissingInputs(std::move(missing));

  JobRecord job;
  job.created = clock_.wall();
  job.id = ids_.new_job_id(job.created);
  job.submitter = asked.submitter;
  job.request_id = asked.request_id;
  job.request_hash = asked.request_hash;
  job.spec = asked.spec;
  job.inputs = asked.inputs;
  job.labels = asked.labels;
  job.threads = asked.threads;
  job.priority = asked.priority;
  job.memory_bytes = asked.memory_bytes;
  job.limits = asked.limits;
  table.insert(job);
  return job;
}

std::optional<JobQueue::Taken> JobQueue::start(JobTable& table, const std::string& id,
                                               const std::function<std::string(const AttemptKey&)>& name) const {
  auto job = table.find(id);
  if (!job || job->state != JobState::Queued) return std::nullopt;
  Taken taken{*std::move(job), ids_.new_token()};
  const WallTime now = clock_.wall();
  apply(taken.job, JobEvent::Start, now);
  ++taken.job.attempt;
  taken.job.started = now;
  taken.job.token_hash = ids_.fingerprint(taken.token);
  taken.job.process = name({id, taken.job.attempt});
  taken.job.batch_id.clear();
  taken.job.batch_host.clear();
  taken.job.begun.reset();
  taken.job.not_before.reset();
  table.update(taken.job);
  return taken;
}

std::optional<JobRecord> JobQueue::begin(JobTable& table, const AttemptKey& key) const {
  auto job = table.find(key.job_id);
  if (!job || job->attempt != key.attempt || !is_held(job->state) || job->begun) return std::nullopt;
  job->begun = clock_.wall();
  table.update(*job);
  return job;
}

std::optional<JobRecord> JobQueue::name(JobTable& table, const AttemptKey& key, const std::string& batch_id,
                                        const std::string& host) const {
  auto job = table.find(key.job_id);
  if (!job || job->attempt != key.attempt || !is_held(job->state)) return std::nullopt;
  if (job->batch_id == batch_id && (host.empty() || job->batch_host == host)) return std::nullopt;
  job->batch_id = batch_id;
  if (!host.empty()) job->batch_host = host;
  table.update(*job);
  return job;
}

JobRecord JobQueue::cancel(JobTable& table, const std::string& id) const {
  JobRecord job = require_job(table, id);
  const JobState before = job.state;
  if (is_terminal(before)) return job;
  apply(job, JobEvent::Cancel, clock_.wall());
  if (job.state != before) table.update(job);
  return job;
}

JobRecord JobQueue::require_attempt(JobTable& table, const AttemptKey& key, const std::string& token) const {
  auto found = table.find(key.job_id);
  if (!found || found->attempt != key.attempt || found->token_hash != ids_.fingerprint(token)) throw lease_lost(key);
  return *std::move(found);
}

JobRecord JobQueue::complete(JobTable& table, const AttemptKey& key, const std::string& token, const Outcome& outcome,
                             LossCause stop_cause) const {
  JobRecord job = require_attempt(table, key, token);
  if (is_terminal(job.state) && is_same_outcome(job, outcome)) return job;
  if (!is_held(job.state)) throw lease_lost(key);

  const WallTime now = clock_.wall();
  if (const auto* delivered = std::get_if<Delivered>(&outcome)) {
    require_blobs(table, delivered->artifacts);
    apply(job, JobEvent::Succeed, now);
    job.artifacts = delivered->artifacts;
  } else if (const auto* failure = std::get_if<JobFailure>(&outcome)) {
    apply(job, JobEvent::Fail, now);
    if (job.state == JobState::Failed) job.failure = *failure;
  } else if (job.state == JobState::Running) {
    return *lose(table, key, stop_cause, "");
  } else {
    apply(job, JobEvent::Stop, now);
  }
  table.update(job);
  return job;
}

std::optional<JobRecord> JobQueue::lose(JobTable& table, const AttemptKey& key, LossCause cause,
                                        const std::string& detail) const {
  auto found = table.find(key.job_id);
  if (!found || found->attempt != key.attempt || !is_held(found->state)) return std::nullopt;
  JobRecord job = *std::move(found);
  const WallTime now = clock_.wall();
  const std::string what = describe(cause, detail) + place_of(job.batch_id, job.batch_host);
  job.losses.push_back({job.attempt, reason_of(cause), job.batch_id, job.batch_host, now});
  if (job.losses.size() > kMostLostAttempts) job.losses.erase(job.losses.begin());
  if (cause == LossCause::Released) {
    apply(job, JobEvent::Release, now);
  } else {
    const bool is_nobodys_fault = cause == LossCause::Preempted || cause == LossCause::NeverBegun;
    if (!is_nobodys_fault) ++job.lost_attempts;
    job.last_loss = {reason_of(cause), what};
    if (cause == LossCause::Crashed) ++job.crashes;
    const bool is_poison = job.crashes >= limits_.max_crashes;
    const bool is_last = job.lost_attempts >= limits_.max_attempts;
    apply(job, is_poison || is_last ? JobEvent::GiveUp : JobEvent::Lose, now);
    if (job.state == JobState::Queued) job.not_before = now + retry_delay(std::max(job.lost_attempts, 1));
    if (job.state == JobState::Failed) {
      const std::string before = losses_before(job);
      // A batch system writes elsewhere, unless the data folder is shared.
      const std::string where = job.batch_id.empty() ? "what the worker printed is in logs/ of the daemon's folder"
                                                     : "the batch system tells more of them";
      if (is_poison)
        job.failure = {"WORKER_CRASHED", what + ", for the second time" + before +
                                             "; the input may be too large for the machine, " + where};
      else
        job.failure = {"ATTEMPTS_EXHAUSTED", "attempt " + std::to_string(job.lost_attempts) + " of " +
                                                 std::to_string(limits_.max_attempts) + " was lost as well: " + what +
                                                 before + "; " + where};
    }
  }
  job.process.clear();
  table.update(job);
  return job;
}

std::optional<JobRecord> JobQueue::fail(JobTable& table, const AttemptKey& key, const JobFailure& failure) const {
  auto found = table.find(key.job_id);
  if (!found || found->attempt != key.attempt || !is_held(found->state)) return std::nullopt;
  JobRecord job = *std::move(found);
  apply(job, JobEvent::Fail, clock_.wall());
  if (job.state == JobState::Failed) job.failure = failure;
  job.process.clear();
  table.update(job);
  return job;
}

std::chrono::milliseconds JobQueue::retry_delay(int lost_attempts) const {
  std::chrono::milliseconds delay = limits_.retry_delay;
  for (int i = 1; i < lost_attempts; ++i) delay *= 4;
  return delay;
}

JobRecord JobQueue::put_checkpoint(JobTable& table, const AttemptKey& key, const std::string& token,
                                   const Checkpoint& checkpoint) const {
  JobRecord job = require_attempt(table, key, token);
  if (!is_held(job.state)) throw lease_lost(key);
  const auto size = table.blob_size(checkpoint.digest);
  if (!size || *size != checkpoint.size)
    throw Refusal(RefusalKind::FailedPrecondition, "CHECKPOINT_MISSING",
                  "the checkpoint is " + checkpoint.digest + " with " + std::to_string(checkpoint.size) +
                      " bytes, which has not been uploaded; upload it with WriteBlob first");
  Checkpoint kept = checkpoint;
  kept.attempt = key.attempt;
  if (job.checkpoint == kept) return job;
  job.checkpoint = std::move(kept);
  table.update(job);
  return job;
}

std::vector<std::string> JobQueue::remove(JobTable& table, const std::string& id) const {
  const JobRecord job = require_job(table, id);
  if (is_held(job.state))
    throw Refusal(RefusalKind::FailedPrecondition, "JOB_RUNNING",
                  "job '" + id + "' is " + to_string(job.state) + "; cancel it and delete it when it has ended");
  std::vector<std::string> digests;
  for (const Artifact& artifact : job.artifacts) digests.push_back(artifact.digest);
  if (job.checkpoint) digests.push_back(job.checkpoint->digest);
  std::sort(digests.begin(), digests.end());
  digests.erase(std::unique(digests.begin(), digests.end()), digests.end());
  table.erase(id);
  return digests;
}

}  // namespace saltus::server
