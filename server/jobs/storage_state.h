#pragma once

#include "server/jobs/refusal.h"

#include <atomic>
#include <functional>
#include <string>

namespace saltus::server {

/// Whether the daemon may still write. A write that the disk did not take, or an fsync that failed, may have lost bytes
/// that the daemon believes to be safe, and asking again does not bring them back: from then on it only reads, until
/// somebody has looked at the disk and started it again. Thread-safe.
class StorageState {
 public:
  /// `on_failed` is called once, by the thread that failed, with what went wrong; it must not block.
  explicit StorageState(std::function<void(const std::string& reason)> on_failed = [](const std::string&) {})
      : on_failed_(std::move(on_failed)) {}

  void fail(const std::string& reason) {
    if (!has_failed_.exchange(true)) on_failed_(reason);
  }
  bool has_failed() const { return has_failed_; }

  /// Throws Unavailable STORE_UNAVAILABLE after a failure.
  void require_writable() const {
    if (has_failed_) throw refusal();
  }
  static Refusal refusal() {
    return {RefusalKind::Unavailable, "STORE_UNAVAILABLE",
            "the daemon's disk has failed, so it only reads; see its log, repair the disk and start it again", kRetry};
  }

 private:
  // Somebody may be starting it again, and a worker must not miss that while its lease lasts.
  static constexpr std::chrono::milliseconds kRetry{5000};
  const std::function<void(const std::string&)> on_failed_;
  std::atomic<bool> has_failed_{false};
};

}  // namespace saltus::server
