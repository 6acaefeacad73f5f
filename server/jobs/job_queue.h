#pragma once

#include "server/jobs/clock.h"
#include "server/jobs/id_source.h"
#include "server/jobs/job.h"
#include "server/jobs/job_store.h"
#include "server/jobs/refusal.h"

#include <functional>
#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace saltus::server {

struct QueueLimits {
  int max_queued = 10000;
  int max_attempts = 3;             ///< lost attempts after which a job is given up
  int max_crashes = 2;              ///< deaths by a signal after which a job counts as poison
  int max_queued_of_submitter = 0;  ///< for jobs that have a quota; 0: no limit but max_queued
  /// Before the second attempt; four times as long before each one after it.
  std::chrono::milliseconds retry_delay{5000};
};

/// Why an attempt ended without an outcome.
enum class LossCause {
  Crashed,       ///< the worker died by a signal
  Exited,        ///< the worker ended without completing
  Stopped,       ///< the worker stopped although nobody asked it to
  Vanished,      ///< the worker's process was gone after a restart of the daemon
  LeaseExpired,  ///< nothing was heard of the worker for too long
  Stalled,       ///< the worker's heartbeat goes on, its work does not
  NoRoom,        ///< the disk had no room for the results
  LaunchFailed,  ///< the worker could not be started
  NeverBegun,    ///< whoever had taken the job was not heard of again before its work began; does not count
  Released,      ///< the daemon stopped the worker to shut down; does not count
  // In a batch system:
  TimeLimit,   ///< the worker was ended at the time that the batch system gives it
  Preempted,   ///< the worker was ended for the sake of others; does not count
  NodeFailed,  ///< the worker's machine has failed
  Withdrawn,   ///< somebody else has taken the worker out of the batch system
};

/// A clause for people: "the worker died by signal 9".
std::string describe(LossCause cause, const std::string& detail);
/// A word for programs, such as LEASE_EXPIRED.
std::string reason_of(LossCause cause);

struct Delivered {
  std::vector<Artifact> artifacts;
};
struct Stopped {};
/// What a worker reports at the end.
using Outcome = std::variant<Delivered, JobFailure, Stopped>;

/// Decides what becomes of jobs. Has no thread, file or clock of its own and keeps nothing: each method works on the
/// rows of one transaction. Throws Refusal when a call cannot be granted; the rows are then to be rolled back.
class JobQueue {
 public:
  JobQueue(const Clock& clock, IdSource& ids, QueueLimits limits) : clock_(clock), ids_(ids), limits_(limits) {}

  /// Appends a job. With a request_id seen before: the job made then, or ALREADY_EXISTS when it was for another
  /// content.
  /// `require_room` is asked before anything new is kept; it throws when there is no room.
  JobRecord submit(
      JobTable& table, const NewJob& job, const std::function<void()>& require_room = [] {}) const;

  struct Taken {
    JobRecord job;
    std::string token;
  };
  /// Starts the next attempt. Nothing when the job is not queued any more. `name`: the launcher's name for the worker,
  /// when it has one before the worker is there.
  std::optional<Taken> start(
      JobTable& table, const std::string& id,
      const std::function<std::string(const AttemptKey&)>& name = [](const AttemptKey&) {
        return std::string();
      }) const;
  /// The worker of the attempt has come out of a batch system's queue. Nothing when that is known, or the attempt has
  /// ended.
  std::optional<JobRecord> begin(JobTable& table, const AttemptKey& key) const;
  /// What the batch system calls the attempt, and where it runs it ("": not yet). Nothing as above.
  std::optional<JobRecord> name(JobTable& table, const AttemptKey& key, const std::string& batch_id,
                                const std::string& host) const;

  /// Idempotent.
  JobRecord cancel(JobTable& table, const std::string& id) const;

  /// Ends an attempt with its outcome. Repeating the same outcome is allowed. Throws Aborted LEASE_LOST when the
  /// attempt or the token is not the current one. A worker that has stopped unasked has lost its attempt for
  /// `stop_cause`.
  JobRecord complete(JobTable& table, const AttemptKey& key, const std::string& token, const Outcome& outcome,
                     LossCause stop_cause = LossCause::Stopped) const;

  /// Ends an attempt without an outcome. Nothing when it had ended before. `detail` goes into the failure message.
  /// The job is queued again with a delay, or fails with ATTEMPTS_EXHAUSTED or WORKER_CRASHED.
  std::optional<JobRecord> lose(JobTable& table, const AttemptKey& key, LossCause cause,
                                const std::string& detail) const;

  /// Ends an attempt because another one would end the same way. Nothing when it had ended before.
  std::optional<JobRecord> fail(JobTable& table, const AttemptKey& key, const JobFailure& failure) const;

  /// From now on the next attempt goes on from `checkpoint`, whose `attempt` is set here. Idempotent. Throws Aborted
  /// LEASE_LOST as complete() does, and FailedPrecondition CHECKPOINT_MISSING when its blob is not there with that
  /// size.
  JobRecord put_checkpoint(JobTable& table, const AttemptKey& key, const std::string& token,
                           const Checkpoint& checkpoint) const;

  /// Removes the job and returns the digests of its artefacts and its checkpoint. Throws FailedPrecondition
  /// JOB_RUNNING.
  std::vector<std::string> remove(JobTable& table, const std::string& id) const;

 private:
  std::chrono::milliseconds retry_delay(int lost_attempts) const;
  /// The job of the current attempt. Throws Aborted LEASE_LOST.
  JobRecord require_attempt(JobTable& table, const AttemptKey& key, const std::string& token) const;

  const Clock& clock_;
  IdSource& ids_;
  QueueLimits limits_;
};

/// Aborted LEASE_LOST: that attempt is not the current one any more.
Refusal lease_lost(const AttemptKey& key);
/// Throws NotFound JOB_NOT_FOUND.
JobRecord require_job(JobReader& reader, const std::string& id);
/// Throws the same, so that nobody learns which jobs others have.
void require_owner(const JobRecord& job, const std::string& submitter);

}  // namespace saltus::server
