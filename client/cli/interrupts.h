#pragma once

#include <atomic>
#include <functional>
#include <thread>

namespace saltus::cli {

/// Turns SIGINT, SIGTERM and SIGHUP into calls of `on_interrupt(count)` on a thread of its own, where anything may be
/// called; count is 1 for the first signal. SIGHUP comes when the terminal has gone, and stays ignored where it was.
/// One object at a time; the former handlers come back when it ends.
class Interrupts {
 public:
  explicit Interrupts(std::function<void(int count)> on_interrupt);
  ~Interrupts();
  Interrupts(const Interrupts&) = delete;
  Interrupts& operator=(const Interrupts&) = delete;

  int count() const { return count_; }

 private:
  int read_end_ = -1;
  std::atomic<int> count_ = 0;
  std::function<void(int)> on_interrupt_;
  std::thread thread_;
};

}  // namespace saltus::cli
