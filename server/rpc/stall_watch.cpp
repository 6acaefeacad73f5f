#include "server/rpc/stall_watch.h"

namespace saltus::server {

StallWatch::Stream::Stream(StallWatch& watch, grpc::CallbackServerContext& context) : watch_(watch), context_(context) {
  const std::lock_guard lock(watch_.mutex_);
  watch_.streams_.insert(this);
}

StallWatch::Stream::~Stream() {
  const std::lock_guard lock(watch_.mutex_);
  watch_.streams_.erase(this);
}

void StallWatch::Stream::waits() {
  const SteadyTime now = watch_.clock_.steady();
  const std::lock_guard lock(watch_.mutex_);
  waits_since_ = now;
}

void StallWatch::Stream::moved() {
  const std::lock_guard lock(watch_.mutex_);
  waits_since_.reset();
}

int StallWatch::cut() {
  const SteadyTime now = clock_.steady();
  int cut = 0;
  // Under the lock no stream can end. TryCancel does not call back: gRPC's own threads do.
  const std::lock_guard lock(mutex_);
  for (Stream* stream : streams_) {
    if (!stream->waits_since_ || now - *stream->waits_since_ < limit_) continue;
    stream->waits_since_.reset();
    stream->context_.TryCancel();
    ++cut;
  }
  return cut;
}

}  // namespace saltus::server
