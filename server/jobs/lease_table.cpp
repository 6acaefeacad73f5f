#include "server/jobs/lease_table.h"

#include <tuple>
#include <utility>

namespace saltus::server {
namespace {

auto place(const JobProgress& progress) { return std::tuple(progress.stage, progress.level, progress.iteration); }

}  // namespace

const LeaseTable::Lease* LeaseTable::find(const AttemptKey& key) const {
  const auto found = leases_.find(key.job_id);
  return found != leases_.end() && found->second.attempt == key.attempt ? &found->second : nullptr;
}

LeaseTable::Lease* LeaseTable::find(const AttemptKey& key) {
  return const_cast<Lease*>(std::as_const(*this).find(key));
}

void LeaseTable::grant(const AttemptKey& key, const std::string& token_hash, SteadyTime now, const JobLimits& limits,
                       std::chrono::milliseconds used) {
  Lease lease;
  lease.attempt = key.attempt;
  lease.token_hash = token_hash;
  lease.until = now + lease_;
  lease.limits = limits;
  if (limits.wall_seconds > 0) lease.wall_end = now + std::chrono::seconds(limits.wall_seconds) - used;
  lease.moved = now;
  leases_[key.job_id] = lease;
}

void LeaseTable::grant_waiting(const AttemptKey& key, const std::string& token_hash, SteadyTime now,
                               const JobLimits& limits) {
  grant(key, token_hash, now, limits);
  leases_[key.job_id].phase = Lease::Phase::Waiting;
}

void LeaseTable::expect(const AttemptKey& key, SteadyTime until) {
  Lease* lease = find(key);
  if (!lease || lease->phase != Lease::Phase::Waiting) return;
  lease->phase = Lease::Phase::Expected;
  lease->until = until;
}

bool LeaseTable::begin(const AttemptKey& key, SteadyTime now) {
  Lease* lease = find(key);
  if (!lease || lease->phase == Lease::Phase::Running) return false;
  lease->phase = Lease::Phase::Running;
  lease->until = now + lease_;
  if (lease->limits.wall_seconds > 0) lease->wall_end = now + std::chrono::seconds(lease->limits.wall_seconds);
  lease->moved = now;
  return true;
}

bool LeaseTable::is_waiting(const AttemptKey& key) const {
  const Lease* lease = find(key);
  return lease && lease->phase == Lease::Phase::Waiting;
}

bool LeaseTable::has_begun(const AttemptKey& key) const {
  const Lease* lease = find(key);
  return lease && lease->phase == Lease::Phase::Running;
}

bool LeaseTable::is_held_by(const AttemptKey& key, const std::string& token_hash) const {
  const Lease* lease = find(key);
  return lease && lease->token_hash == token_hash;
}

bool LeaseTable::is_for(const AttemptKey& key, const std::string& worker) {
  Lease* lease = find(key);
  if (!lease) return false;
  if (worker.empty()) return true;
  if (lease->worker.empty()) lease->worker = worker;
  return lease->worker == worker;
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

void LeaseTable::progressed(const AttemptKey& key, const JobProgress& progress, SteadyTime now) {
  Lease* lease = find(key);
  if (!lease) return;
  if (place(lease->progress) != place(progress)) lease->moved = now;
  lease->progress = progress;
}

std::optional<Limit> LeaseTable::exceeded(const Lease& lease, SteadyTime now) {
  if (lease.wall_end && now >= *lease.wall_end) return Limit::WallTime;
  if (lease.limits.cpu_seconds > 0 && lease.progress.cpu_seconds > static_cast<double>(lease.limits.cpu_seconds))
    return Limit::CpuTime;
  if (lease.limits.memory_bytes > 0 && lease.progress.memory_bytes > lease.limits.memory_bytes) return Limit::Memory;
  return std::nullopt;
}

bool LeaseTable::is_cancelled(const AttemptKey& key) const {
  const Lease* lease = find(key);
  return lease && lease->cancelled;
}

LeaseTable::Due LeaseTable::due(SteadyTime now) {
  Due due;
  for (auto& [job_id, lease] : leases_) {
    const AttemptKey key{job_id, lease.attempt};
    const bool is_waiting = lease.phase == Lease::Phase::Waiting;
    if (now >= lease.until && !lease.is_expired && !is_waiting) {
      lease.is_expired = true;
      due.expired.push_back(key);
    }
    // A job that is being cancelled ends by its ladder.
    const bool is_watched = lease.phase == Lease::Phase::Running && !lease.is_expired && !lease.cancelled &&
                            (!lease.quiet_until || now >= *lease.quiet_until);
    if (is_watched) {
      if (const auto limit = exceeded(lease, now)) {
        lease.is_expired = true;
        due.over_limit.emplace_back(key, *limit);
      } else if (now >= lease.moved + stall_) {
        lease.is_expired = true;
        due.stalled.push_back(key);
      }
    }
    if (!lease.cancelled) continue;
    // Nobody is there who could see it in a heartbeat's answer.
    const bool is_deaf = lease.phase != Lease::Phase::Running;
    if (lease.step == Lease::Step::None && (is_deaf || now >= *lease.cancelled + ladder_.terminate)) {
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

void LeaseTable::retry_end(const AttemptKey& key, SteadyTime now) {
  if (Lease* lease = find(key)) {
    lease->is_expired = false;
    lease->until = now + lease_;
    lease->quiet_until = lease->until;
  }
}

std::vector<AttemptKey> LeaseTable::all() const {
  std::vector<AttemptKey> keys;
  for (const auto& [job_id, lease] : leases_) keys.push_back({job_id, lease.attempt});
  return keys;
}

}  // namespace saltus::server
