#pragma once

#include "server/jobs/clock.h"
#include "server/jobs/job.h"

#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace saltus::server {

/// Times of the ladder from a cancel to a dead process, each counted from the cancel.
struct CancelLadder {
  std::chrono::milliseconds terminate{1000};  ///< time for the worker to see it in a heartbeat's answer
  std::chrono::milliseconds kill{1600};
};

/// What an attempt may use up, as far as the daemon can see it.
enum class Limit { WallTime, CpuTime, Memory };

/// Who holds which job, until when, and whether he gets on. Has no lock and no clock of its own.
class LeaseTable {
 public:
  /// An attempt whose stage, level and iteration stay the same for `stall` stands still, however alive its heartbeat.
  LeaseTable(std::chrono::milliseconds lease, CancelLadder ladder, std::chrono::milliseconds stall)
      : lease_(lease), ladder_(ladder), stall_(stall) {}

  enum class Wanted { Continue, Cancel };

  /// `used` is the wall time that the attempt has used before `now`.
  void grant(const AttemptKey& key, const std::string& token_hash, SteadyTime now, const JobLimits& limits = {},
             std::chrono::milliseconds used = {});
  /// As grant(), for a worker that waits for its turn in a queue elsewhere, as long as that takes: neither the lease
  /// nor the wall time runs before begin().
  void grant_waiting(const AttemptKey& key, const std::string& token_hash, SteadyTime now, const JobLimits& limits);
  /// Its turn has come: when the worker has not called by `until`, the lease has expired. Nothing happens when it does
  /// not wait any more.
  void expect(const AttemptKey& key, SteadyTime until);
  /// The worker is there: lease and wall time run from now. False when they ran before.
  bool begin(const AttemptKey& key, SteadyTime now);
  bool is_waiting(const AttemptKey& key) const;
  /// Its worker has called.
  bool has_begun(const AttemptKey& key) const;
  /// The attempt and the token are the current ones, expired or not.
  bool is_held_by(const AttemptKey& key, const std::string& token_hash) const;
  void end(const AttemptKey& key);
  void cancel(const std::string& job_id, SteadyTime now);
  /// Prolongs the lease. Nothing when the attempt or the token is not the current one.
  std::optional<Wanted> renew(const AttemptKey& key, const std::string& token_hash, SteadyTime now);
  /// Whether the attempt is this process's: the first that asks has it. "" is a process without a name, which is let
  /// in.
  bool is_for(const AttemptKey& key, const std::string& worker);
  /// What the current attempt has reported.
  void progressed(const AttemptKey& key, const JobProgress& progress, SteadyTime now);
  bool is_cancelled(const AttemptKey& key) const;

  /// Attempts to act upon, each reported once for each step.
  struct Due {
    std::vector<AttemptKey> expired;
    std::vector<AttemptKey> stalled;
    std::vector<std::pair<AttemptKey, Limit>> over_limit;
    std::vector<AttemptKey> terminate;
    std::vector<AttemptKey> kill;
  };
  Due due(SteadyTime now);
  /// The end of an attempt that was due could not be recorded: report it again after one more lease.
  void retry_end(const AttemptKey& key, SteadyTime now);

  std::vector<AttemptKey> all() const;
  int size() const { return static_cast<int>(leases_.size()); }

 private:
  struct Lease {
    int attempt = 0;
    std::string token_hash;
    std::string worker;  ///< the process that has it; "" while nobody has said
    /// Waiting: in a queue elsewhere. Expected: out of it, not heard of yet.
    enum class Phase { Waiting, Expected, Running } phase = Phase::Running;
    SteadyTime until;
    bool is_expired = false;  ///< the end of the attempt has been reported as due
    JobLimits limits;
    std::optional<SteadyTime> wall_end;
    std::optional<SteadyTime> quiet_until;  ///< no end is reported before: recording it has failed
    JobProgress progress;
    SteadyTime moved;  ///< when stage, level or iteration last changed
    std::optional<SteadyTime> cancelled;
    enum class Step { None, Terminated, Killed } step = Step::None;
  };
  Lease* find(const AttemptKey& key);
  const Lease* find(const AttemptKey& key) const;
  static std::optional<Limit> exceeded(const Lease& lease, SteadyTime now);

  std::chrono::milliseconds lease_;
  CancelLadder ladder_;
  std::chrono::milliseconds stall_;
  std::map<std::string, Lease> leases_;
};

}  // namespace saltus::server
