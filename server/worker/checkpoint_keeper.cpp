#include "server/worker/checkpoint_keeper.h"

#include <algorithm>
#include <iostream>
#include <utility>

namespace saltus::worker {
namespace {

/// Making checkpoints takes at most one part in so many of the solver's time.
constexpr int kShareOfTime = 20;

}  // namespace

CheckpointKeeper::CheckpointKeeper(std::chrono::milliseconds interval, Put put, const std::stop_token& stop,
                                   std::function<Clock::time_point()> now)
    : interval_(interval),
      put_(std::move(put)),
      now_(std::move(now)),
      due_(now_() + interval_),
      thread_([this](const std::stop_token& end) { run(end); }),
      on_stop_(stop, [this] { thread_.request_stop(); }) {}

CheckpointKeeper::~CheckpointKeeper() {
  thread_.request_stop();
  thread_.join();
}

void CheckpointKeeper::offer(const std::function<std::string()>& make) {
  const Clock::time_point begin = now_();
  if (interval_ <= std::chrono::milliseconds(0) || begin < due_) return;
  {
    std::lock_guard lock(mutex_);
    if (is_busy_ || pending_) return;
  }
  std::string bytes = make();
  due_ = begin + std::max<Clock::duration>(interval_, kShareOfTime * (now_() - begin));
  {
    std::lock_guard lock(mutex_);
    pending_ = std::move(bytes);
  }
  changed_.notify_one();
}

void CheckpointKeeper::run(const std::stop_token& stop) {
  while (true) {
    std::string bytes;
    {
      std::unique_lock lock(mutex_);
      if (!changed_.wait(lock, stop, [this] { return pending_.has_value(); }) || stop.stop_requested()) return;
      bytes = std::move(*pending_);
      pending_.reset();
      is_busy_ = true;
    }
    try {
      put_(bytes, stop);
      ++kept_;
    } catch (const std::exception& error) {
      // The one before still stands, and the next may get through.
      if (!stop.stop_requested())
        std::cerr << "saltus-worker: a checkpoint could not be put in safety: " << error.what() << std::endl;
    }
    std::lock_guard lock(mutex_);
    is_busy_ = false;
  }
}

}  // namespace saltus::worker
