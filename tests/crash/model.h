#pragma once

#include "tests/crash/connection.h"

#include <atomic>
#include <chrono>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace saltus::crash {

/// A job as its client knows it.
struct KnownJob {
  v1::CreateRegistrationJobRequest request;
  std::string id;  ///< "" while the answer to its creation is not known
  int batch = 0;   ///< jobs with the same number were asked for in one call; 0: alone
  bool is_cancel_tried = false;
  bool is_delete_tried = false;    ///< and the answer is not known
  bool is_deleted = false;         ///< which was acknowledged, or found to be so after a crash
  std::optional<std::string> end;  ///< state, reason, times and artefacts, once it was seen in a terminal state
  std::chrono::system_clock::time_point end_time{};  ///< by the daemon's clock
  std::string own_input;  ///< a digest that nobody asks about any more: only the job keeps the daemon from removing it
  std::vector<v1::Artifact> artifacts;
  bool is_checked = false;  ///< its artefacts have been read
};

/// An upload whose stream was cut, to be continued.
struct KnownUpload {
  std::string bytes, id;
  std::int64_t committed = 0;  ///< the daemon has said that so much is safe
  int collections = 0;         ///< how often garbage had been collected when the daemon last said so, or when it began
};

/// The daemon's clock and what goes with it, for all clients together.
struct Era {
  std::atomic<int> days_ahead = 0;   ///< of the real time
  std::atomic<int> collections = 0;  ///< how often garbage was, or may have been, collected

  /// Another daemon begins. The one before may have collected garbage by itself.
  void begin_daemon();
  /// A daemon may have collected garbage since `collections` was as told, asked or by itself.
  bool may_have_collected(int since) const;
  /// A job that ended then may be gone.
  bool is_over(std::chrono::system_clock::time_point end) const;

 private:
  bool may_have_collected_by_itself() const;
  std::atomic<std::chrono::steady_clock::time_point> daemon_start_{};
};

/// What one client was told, and whether the daemon keeps to it. A breach is a Violation.
class Model {
 public:
  explicit Model(std::string owner) : owner_(std::move(owner)) {}

  const std::string& owner() const { return owner_; }
  std::vector<KnownJob> jobs;
  std::vector<std::string> uploads;  ///< digests that were acknowledged
  std::vector<KnownUpload> pending;  ///< cut

  /// A new job to ask for, with a request id and labels of its own.
  KnownJob& add(const v1::RegistrationSpec& spec);
  /// Begins a new batch, to whose jobs its number is to be given.
  int next_batch() { return ++batches_; }
  /// The job is gone. Throws Violation when it must not be.
  void observe_absence(KnownJob& job) const;
  bool may_be_collected(const KnownJob& job) const { return job.end && era.is_over(job.end_time); }
  /// Reads what the job refers to and nobody else asks about. Throws Violation when it is not there.
  void check_own_input(Connection& daemon, const KnownJob& job) const;
  /// The daemon says this of an upload that was cut. Throws Violation when it must not.
  void observe(KnownUpload& upload, const v1::QueryWriteStatusResponse& said);
  /// The daemon says this of the job. Throws Violation when it must not.
  void observe(KnownJob& job, const v1::RegistrationJob& said);

  /// To be called first after a restart: asks again for what was not answered, then compares everything. `listed` is
  /// all that the daemon has after the questions. Throws Violation, or DaemonGone.
  void resolve(Connection& daemon);
  void compare(Connection& daemon, const std::vector<v1::RegistrationJob>& listed);

  /// Artefacts of a job of the real worker that was not disturbed: all others of its kind must be the same.
  static std::map<std::string, std::string> reference;
  static Era era;

 private:
  void check_artifacts(Connection& daemon, KnownJob& job);
  std::string owner_;
  /// A batch whose answer is not known was done whole or not at all.
  void check_batches(const std::vector<v1::RegistrationJob>& listed) const;
  int made_ = 0, batches_ = 0;
};

}  // namespace saltus::crash
