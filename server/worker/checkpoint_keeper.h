#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <stop_token>
#include <thread>

namespace saltus::worker {

/// Puts checkpoints in safety at a bounded rate, from a thread of its own: the solver only waits while one is made.
/// Never two at once: what is offered while one is on its way is not made, so all may be made in the same place.
class CheckpointKeeper {
 public:
  using Clock = std::chrono::steady_clock;
  /// Sends what was made last and returns when it is safe. Runs on the keeper's thread; throws std::exception. Has to
  /// end soon when stop is requested.
  using Put = std::function<void(const std::stop_token& stop)>;

  /// `interval` lies between the beginnings of two; more, when making one takes more than a twentieth of it. 0: none is
  /// ever made. `stop` ends what is on its way.
  CheckpointKeeper(std::chrono::milliseconds interval, Put put, const std::stop_token& stop,
                   std::function<Clock::time_point()> now = Clock::now);
  /// Cuts off what is on its way.
  ~CheckpointKeeper();
  CheckpointKeeper(const CheckpointKeeper&) = delete;
  CheckpointKeeper& operator=(const CheckpointKeeper&) = delete;

  /// Calls `make` when a checkpoint is due, and has put what it made. One that cannot be made (std::exception) is told
  /// of and not put. One thread at a time.
  void offer(const std::function<void()>& make);

  /// How many are safe.
  int kept() const { return kept_; }

 private:
  void run(const std::stop_token& stop);

  const std::chrono::milliseconds interval_;
  const Put put_;
  const std::function<Clock::time_point()> now_;
  Clock::time_point due_;
  std::atomic<int> kept_ = 0;
  std::mutex mutex_;
  std::condition_variable_any changed_;
  bool is_pending_ = false, is_busy_ = false;
  std::jthread thread_;
  std::stop_callback<std::function<void()>> on_stop_;
};

}  // namespace saltus::worker
