#pragma once

#include "server/jobs/fsck.h"
#include "server/jobs/garbage_collector.h"

#include <chrono>
#include <condition_variable>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace saltus::server {

/// What the daemon does for itself: collects garbage now and then, and when it is asked to, on a thread of its own.
class Maintenance {
 public:
  struct Intervals {
    std::chrono::milliseconds first{std::chrono::minutes(1)};  ///< after the start, when the rush is over
    std::chrono::milliseconds next{std::chrono::hours(1)};
  };
  using Done = std::function<void(std::exception_ptr error, const GarbageReport& report)>;

  Maintenance(JobStore& rows, BlobStore& bytes, const Clock& clock, Retention retention, Intervals intervals,
              std::function<void(const std::string&)> log);
  /// Waits for a collection that is under way; who still waits for one is told UNAVAILABLE.
  ~Maintenance();
  Maintenance(const Maintenance&) = delete;
  Maintenance& operator=(const Maintenance&) = delete;

  /// Soon; all who ask before it begins share one collection. `done` is called on the own thread. Never blocks.
  void collect(Done done);
  /// A check that its caller drives.
  std::unique_ptr<Fsck> fsck();

 private:
  void run();
  GarbageReport collect_now(std::exception_ptr& error);

  JobStore& rows_;
  BlobStore& bytes_;
  const Clock& clock_;
  const Intervals intervals_;
  const std::function<void(const std::string&)> log_;
  GarbageCollector garbage_;

  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<Done> asked_;
  bool is_closing_ = false;
  std::thread thread_;
};

}  // namespace saltus::server
