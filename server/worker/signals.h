#pragma once

#include <stop_token>
#include <thread>

namespace saltus::worker {

/// Turns SIGTERM and SIGINT into a stop token, for a process that only looks after others. To be made before any other
/// thread, since it blocks both signals.
class Signals {
 public:
  Signals();
  ~Signals();
  Signals(const Signals&) = delete;
  Signals& operator=(const Signals&) = delete;

  std::stop_token stop() const { return source_.get_token(); }

 private:
  std::stop_source source_;
  int signals_ = -1, end_ = -1;
  std::thread thread_;
};

}  // namespace saltus::worker
