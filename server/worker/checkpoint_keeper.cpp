#include "server/worker/checkpoint_keeper.h"

#include <algorithm>
#include <iostream>
#include <utility>

namespace saltus::worker {
namespace {

/// Making checkpoints takes at most one part in so many of the solver's time.
constexpr int kShareOfTime = 20;

/// Whether `part` went through. If not, the checkpoint before still stands, and the next may get through.
template <class Part>
bool goes_through(const Part& part, const std::stop_token& stop = {}) {
  try {
    part();
    return true;
  } catch (const std::exception& error) {
    if (!stop.stop_requested())
      std::cerr << "saltus-worker: a checkpoint could not be put in safety: " << error.what() << std::endl;
    return false;
  }
}

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

void CheckpointKeeper::offer(const std::function<void()>& make) {
  const Clock::time_point begin = now_();
  if (interval_ <= std::chrono::milliseconds(0) || begin < due_) return;
  {
    std::lock_guard lock(mutex_);
    if (is_busy_ || is_pending_) return;
  }
  const bool is_made = goes_through([&] { make(); });
  due_ = begin + std::max<Clock::duration>(interval_, kShareOfTime * (now_() - begin));
  if (!is_made) return;
  {
    std::lock_guard lock(mutex_);
    is_pending_ = true;
  }
  changed_.notify_one();
}

void CheckpointKeeper::run(const std::stop_token& stop) {
  while (true) {
    {
      std::unique_lock lock(mutex_);
      if (!changed_.wait(lock, stop, [this] { return is_pending_; }) || stop.stop_requested()) return;
      is_pending_ = false;
      is_busy_ = true;
    }
    if (goes_through([&] { put_(stop); }, stop)) ++kept_;
    std::lock_guard lock(mutex_);
    is_busy_ = false;
  }
}

}  // namespace saltus::worker
