// What still happens in a daemon that is told to stop.
#include "tests/integration/server/daemon_test.h"

#include <grpc/grpc.h>

#include <condition_variable>
#include <mutex>

namespace saltus::server {
namespace {

/// Stands still until leap(); from then on it is a minute later whenever somebody looks.
class LeapingClock final : public Clock {
 public:
  WallTime wall() const override { return WallTime(std::chrono::hours(1)); }
  SteadyTime steady() const override {
    std::lock_guard lock(mutex_);
    ++looks_;
    looked_.notify_all();
    if (is_leaping_) now_ += std::chrono::minutes(1);
    return now_;
  }
  void leap() {
    std::lock_guard lock(mutex_);
    is_leaping_ = true;
  }
  void wait_for_looks(int more) {
    std::unique_lock lock(mutex_);
    looked_.wait(lock, [this, wanted = looks_ + more] { return looks_ >= wanted; });
  }

 private:
  mutable std::mutex mutex_;
  mutable std::condition_variable looked_;
  mutable SteadyTime now_{std::chrono::hours(1)};
  mutable int looks_ = 0;
  bool is_leaping_ = false;
};

class Stop : public testing_support::DaemonTest {
 protected:
  /// The line of `name` in the metrics, with its value.
  std::string line_of(const std::string& name) const {
    const std::string text = "\n" + daemon->metrics().text();
    const auto begin = text.find("\n" + name + " ");
    return begin == std::string::npos ? "" : text.substr(begin + 1, text.find('\n', begin + 1) - begin - 1);
  }
};

// The daemon's own thread lives longer than its server: each of its rounds would call the daemon here.
TEST_F(Stop, ADaemonThatStopsDoesNotCallItself) {
  const std::string pings = "saltusd_callback_latency_seconds_count";
  const auto clock = std::make_shared<LeapingClock>();
  DaemonParts parts;
  parts.clock = clock;
  start(std::move(parts));
  while (line_of(pings) != pings + " 1") {
  }
  clock->leap();
  while (line_of(pings) == pings + " 1") {
  }
  daemon->stop();
  const std::string answered = line_of(pings);
  clock->wait_for_looks(30);
  EXPECT_EQ(line_of(pings), answered);
}

// Whoever lets go of gRPC last waits for its threads, which may look up only after 10 s.
TEST_F(Stop, ADaemonThatIsGoneHasNotWaitedForGrpc) {
  start();
  jobs.reset();
  blobs.reset();
  info.reset();
  worker.reset();
  channel.reset();
  crash();
  EXPECT_NE(grpc_is_initialized(), 0);
}

}  // namespace
}  // namespace saltus::server
