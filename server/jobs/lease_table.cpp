#include "server/jobs/lease_table.h"

namespace saltus::server {

LeaseTable::Lease* LeaseTable::find(const AttemptKey& key) {
  const auto found = leases_.find(key.job_id);
  return found != leases_.end() && found->second.attempt == key.attempt ? &found->second : nullptr;
}

void LeaseTable::grant(const AttemptKey& key, const std::string& token_hash, SteadyTime now) {
  Lease lease;
  lease.attempt = key.attempt;
  lease.token_hash = token_hash;
  lease.until = now + lease_;
  leases_[key.job_id] = lease;
}

void LeaseTable::end(const AttemptKey& key) {
  if (find(key)) leases_.erase(key.job_id);
}

void LeaseTable::cancel(const std::string& job_id, SteadyTime now) {
  const auto found = leases_.find(job_id);
  if (found != leases_.end() && !found->second.cancelled) found->second.cancelled = now;
}

std::optional<LeaseTable::Wanted> LeaseTable::renew(const AttemptKey& key, const std::string& token_hash,
                                                    SteadyTime now) {
  Lease* lease = find(key);
  if (!lease || lease->token_hash != token_hash || lease->is_expired) return std::nullopt;
  lease->until = now + lease_;
  return lease->cancelled ? Wanted::Cancel : Wanted::Continue;
}

bool LeaseTable::is_cancelled(const AttemptKey& key) const {
  const auto found = leases_.find(key.job_id);
  return found != leases_.end() && found->second.attempt == key.attempt && found->second.cancelled;
}

LeaseTable::Due LeaseTable::due(SteadyTime now) {
  Due due;
  for (auto& [job_id, lease] : leases_) {
    const AttemptKey key{job_id, lease.attempt};
    if (now >= lease.until && !lease.is_expired) {
      lease.is_expired = true;
      due.expired.push_back(key);
    }
    if (!lease.cancelled) continue;
    if (lease.step == Lease::Step::None && now >= *lease.cancelled + ladder_.terminate) {
      lease.step = Lease::Step::Terminated;
      due.terminate.push_back(key);
    }
    if (lease.step == Lease::Step::Terminated && now >= *lease.cancelled + ladder_.kill) {
      lease.step = Lease::Step::Killed;
      due.kill.push_back(key);
    }
  }
  return due;
}

void LeaseTable::retry_expiry(const AttemptKey& key, SteadyTime now) {
  if (Lease* lease = find(key)) {
    lease->is_expired = false;
    lease->until = now + lease_;
  }
}

std::vector<AttemptKey> LeaseTable::all() const {
  std::vector<AttemptKey> keys;
  for (const auto& [job_id, lease] : leases_) keys.push_back({job_id, lease.attempt});
  return keys;
}

}  // namespace saltus::server
