#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <string>

namespace saltus::server {

/// Admits so many streams of a kind at a time. HTTP/2's own limit does not refuse: it lets the client wait in silence.
class StreamGate {
 public:
  /// `limit_of_one`: of those who come under one name; 0: no limit but the other.
  StreamGate(std::string kind, int limit, int limit_of_one = 0)
      : kind_(std::move(kind)), limit_(limit), limit_of_one_(limit_of_one) {}

  /// Held as long as the stream lives. The gate must outlive it.
  using Pass = std::shared_ptr<void>;

  /// `name`: who comes; "" has no limit of its own. Throws Exhausted TOO_MANY_STREAMS.
  Pass enter(const std::string& name = "");

 private:
  const std::string kind_;
  const int limit_;
  const int limit_of_one_;
  std::mutex mutex_;
  int open_ = 0;
  std::map<std::string, int> open_of_;
};

}  // namespace saltus::server
