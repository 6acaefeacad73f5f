#include "server/jobs/budget.h"

namespace saltus::server {

std::string gibibytes(std::int64_t bytes) {
  const std::int64_t tenths = (bytes * 10 + (1 << 30) - 1) >> 30;
  return std::to_string(tenths / 10) + "." + std::to_string(tenths % 10) + " GiB";
}

bool Budget::fits(const Demand& demand) const {
  if (held_.empty()) return slots_ > 0;
  Demand sum = demand;
  for (const auto& [key, share] : held_) {
    sum.threads += share.demand.threads;
    sum.memory_bytes += share.demand.memory_bytes;
  }
  return static_cast<int>(held_.size()) < slots_ && !is_too_large(sum);
}

bool Budget::is_too_large(const Demand& demand) const {
  return demand.threads > total_.threads || demand.memory_bytes > total_.memory_bytes;
}

void Budget::take(const AttemptKey& key, const Demand& demand) { held_[key] = {demand, false}; }

void Budget::has_process(const AttemptKey& key) {
  if (const auto found = held_.find(key); found != held_.end()) found->second.has_process = true;
}

void Budget::ended(const AttemptKey& key, bool by_force) {
  const auto found = held_.find(key);
  if (found != held_.end() && !(by_force && found->second.has_process)) held_.erase(found);
}

}  // namespace saltus::server
