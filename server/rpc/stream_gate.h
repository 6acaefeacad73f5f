#pragma once

#include "server/jobs/refusal.h"

#include <atomic>
#include <chrono>
#include <memory>
#include <string>

namespace saltus::server {

/// A stream ends sooner or later; nobody knows when.
constexpr std::chrono::milliseconds kStreamRetry{1000};

/// Admits so many streams of a kind at a time. HTTP/2's own limit does not refuse: it lets the client wait in silence.
class StreamGate {
 public:
  StreamGate(std::string kind, int limit) : kind_(std::move(kind)), limit_(limit) {}

  /// Held as long as the stream lives. The gate must outlive it.
  using Pass = std::shared_ptr<void>;

  /// Throws Refusal TOO_MANY_STREAMS.
  Pass enter() {
    if (++open_ > limit_) {
      --open_;
      throw Refusal(RefusalKind::Exhausted, "TOO_MANY_STREAMS",
                    "the daemon already has " + std::to_string(limit_) + " " + kind_ + " streams; try again later",
                    kStreamRetry);
    }
    return Pass(this, [this](void*) { --open_; });
  }

 private:
  const std::string kind_;
  const int limit_;
  std::atomic<int> open_{0};
};

}  // namespace saltus::server
