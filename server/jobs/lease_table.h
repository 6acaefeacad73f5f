#pragma once

#include "server/jobs/clock.h"
#include "server/jobs/job.h"

#include <map>
#include <optional>
#include <string>
#include <vector>

namespace saltus::server {

/// Times of the ladder from a cancel to a dead process, each counted from the cancel.
struct CancelLadder {
  std::chrono::milliseconds terminate{1000};  ///< time for the worker to see it in a heartbeat's answer
  std::chrono::milliseconds kill{1600};
};

/// Who holds which job, until when. Has no lock and no clock of its own.
class LeaseTable {
 public:
  LeaseTable(std::chrono::milliseconds lease, CancelLadder ladder) : lease_(lease), ladder_(ladder) {}

  enum class Wanted { Continue, Cancel };

  void grant(const AttemptKey& key, const std::string& token_hash, SteadyTime now);
  void end(const AttemptKey& key);
  void cancel(const std::string& job_id, SteadyTime now);
  /// Prolongs the lease. Nothing when the attempt or the token is not the current one.
  std::optional<Wanted> renew(const AttemptKey& key, const std::string& token_hash, SteadyTime now);
  bool is_cancelled(const AttemptKey& key) const;

  /// Attempts to act upon, each reported once for each step.
  struct Due {
    std::vector<AttemptKey> expired;
    std::vector<AttemptKey> terminate;
    std::vector<AttemptKey> kill;
  };
  Due due(SteadyTime now);
  /// What was reported as expired could not be recorded: report it again after one more lease.
  void retry_expiry(const AttemptKey& key, SteadyTime now);

  std::vector<AttemptKey> all() const;
  int size() const { return static_cast<int>(leases_.size()); }

 private:
  struct Lease {
    int attempt = 0;
    std::string token_hash;
    SteadyTime until;
    bool is_expired = false;
    std::optional<SteadyTime> cancelled;
    enum class Step { None, Terminated, Killed } step = Step::None;
  };
  Lease* find(const AttemptKey& key);

  std::chrono::milliseconds lease_;
  CancelLadder ladder_;
  std::map<std::string, Lease> leases_;
};

}  // namespace saltus::server
