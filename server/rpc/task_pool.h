#pragma once

#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace saltus::server {

/// Threads for work that blocks: gRPC has two threads for all callbacks, so a callback that waits for the disk stops
/// every other call. Tasks start in the order of their posting and must not throw. Thread-safe.
class TaskPool {
 public:
  explicit TaskPool(int threads);
  /// Finishes what was posted.
  ~TaskPool();
  TaskPool(const TaskPool&) = delete;
  TaskPool& operator=(const TaskPool&) = delete;

  void post(std::function<void()> task);

 private:
  void run();

  std::mutex mutex_;
  std::condition_variable has_work_;
  std::deque<std::function<void()>> tasks_;
  bool is_closing_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace saltus::server
