#include "server/jobs/upload_quota.h"

#include "server/jobs/refusal.h"

#include <chrono>

namespace saltus::server {
namespace {

// An upload that fails gives its room back; nobody knows when.
constexpr std::chrono::milliseconds kUploadRetry{5000};

}  // namespace

UploadQuota::Claim UploadQuota::claim(const std::string& owner, std::int64_t bytes, std::int64_t limit,
                                      const std::function<std::int64_t()>& stored) {
  std::lock_guard lock(mutex_);
  const auto found = claimed_.find(owner);
  const std::int64_t claimed = found == claimed_.end() ? 0 : found->second;
  const std::int64_t there = stored();
  // Written so that no sum can overflow.
  if (bytes > limit - there - claimed) {
    const bool may_fit_later = bytes <= limit - there;
    throw Refusal(RefusalKind::Exhausted, "QUOTA",
                  "'" + owner + "' has " + std::to_string(there) + " bytes on the server and " +
                      std::to_string(claimed) + " on their way, so " + std::to_string(bytes) +
                      " more would exceed the " + std::to_string(limit) +
                      " bytes that one submitter may have; delete jobs that are done with, images that no job names go "
                      "some days later, or ask an administrator",
                  may_fit_later ? Refusal::RetryAfter(kUploadRetry) : std::nullopt);
  }
  claimed_[owner] += bytes;
  return Claim(this, [this, owner, bytes](void*) {
    std::lock_guard guard(mutex_);
    const auto entry = claimed_.find(owner);
    if ((entry->second -= bytes) == 0) claimed_.erase(entry);
  });
}

}  // namespace saltus::server
