#pragma once

#include "server/jobs/clock.h"

#include <grpcpp/server_context.h>

#include <chrono>
#include <memory>
#include <mutex>
#include <optional>
#include <set>

namespace saltus::server {

/// Cuts transfers off whose other side neither sends nor takes anything: a reader that never reads would keep its place
/// and its message for as long as its connection lives. Thread-safe.
class StallWatch {
 public:
  StallWatch(const Clock& clock, std::chrono::milliseconds limit) : clock_(clock), limit_(limit) {}

  /// One transfer under watch, from construction to destruction.
  class Stream {
   public:
    Stream(StallWatch& watch, grpc::CallbackServerContext& context);
    ~Stream();
    Stream(const Stream&) = delete;
    Stream& operator=(const Stream&) = delete;
    /// From now on it is the other side's turn.
    void waits();
    /// The other side has moved; what follows is our work.
    void moved();

   private:
    friend class StallWatch;
    StallWatch& watch_;
    grpc::CallbackServerContext& context_;
    std::optional<SteadyTime> waits_since_;  // guarded by watch_.mutex_
  };

  /// Ends those that have waited for too long with CANCELLED. To be called now and then. Returns how many.
  int cut();

 private:
  const Clock& clock_;
  const std::chrono::milliseconds limit_;
  std::mutex mutex_;
  std::set<Stream*> streams_;
};

}  // namespace saltus::server
