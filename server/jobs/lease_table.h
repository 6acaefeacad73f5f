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
  void end(const AttemptKey& key);
  void cancel(const std::string& job_id, SteadyTime now);
  /// Prolongs the lease. Nothing when the attempt or the token is not the current one.
  std::optional<Wanted> renew(const AttemptKey& key, const std::string& token_hash, SteadyTime now);
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
  static std::optional<Limit> exceeded(const Lease& lease, SteadyTime now);

  std::chrono::milliseconds lease_;
  CancelLadder ladder_;
  std::chrono::milliseconds stall_;
  std::map<std::string, Lease> leases_;
};

}  // namespace saltus::server
