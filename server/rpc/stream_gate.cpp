#include "server/rpc/stream_gate.h"

#include "server/jobs/refusal.h"

#include <chrono>

namespace saltus::server {
namespace {

// A stream ends sooner or later; nobody knows when.
constexpr std::chrono::milliseconds kStreamRetry{1000};

Refusal too_many(const std::string& who, int limit, const std::string& kind) {
  return {RefusalKind::Exhausted, "TOO_MANY_STREAMS",
          who + " already has " + std::to_string(limit) + " " + kind + " streams; try again when one has ended",
          kStreamRetry};
}

}  // namespace

StreamGate::Pass StreamGate::enter(const std::string& name) {
  const std::lock_guard lock(mutex_);
  if (open_ >= limit_) throw too_many("the daemon", limit_, kind_);
  const bool is_counted = !name.empty() && limit_of_one_ > 0;
  if (is_counted) {
    int& own = open_of_[name];
    if (own >= limit_of_one_) throw too_many("'" + name + "'", limit_of_one_, kind_);
    ++own;
  }
  ++open_;
  return Pass(this, [this, name = is_counted ? name : ""](void*) {
    const std::lock_guard guard(mutex_);
    --open_;
    if (const auto own = open_of_.find(name); own != open_of_.end() && --own->second == 0) open_of_.erase(own);
  });
}

}  // namespace saltus::server
