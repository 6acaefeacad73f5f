#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>

namespace saltus::server {

/// How many bytes of blobs each owner may have on the server. Knows what is on its way in; what is there already is
/// told by those who know. Thread-safe.
class UploadQuota {
 public:
  /// Room for one upload; given back when it goes. The quota must outlive it.
  using Claim = std::shared_ptr<void>;

  /// `stored` tells what the owner has on the server; it may block. What becomes stored must be so before its claim
  /// goes: in between it counts twice, but never not at all. Throws Exhausted QUOTA when `bytes` more are more than
  /// `limit`; with a time to wait when they would fit without what is on its way in.
  Claim claim(const std::string& owner, std::int64_t bytes, std::int64_t limit,
              const std::function<std::int64_t()>& stored);

 private:
  std::mutex mutex_;
  std::map<std::string, std::int64_t> claimed_;
};

}  // namespace saltus::server
