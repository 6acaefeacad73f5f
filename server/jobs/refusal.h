#pragma once

#include <chrono>
#include <optional>
#include <stdexcept>
#include <string>

namespace saltus::server {

enum class RefusalKind {
  InvalidArgument,
  NotFound,
  AlreadyExists,
  FailedPrecondition,
  Exhausted,    ///< a limit is reached; later it may work
  Unavailable,  ///< the daemon is going down or its store is broken
  Aborted,      ///< the caller's attempt is not the current one any more
  OutOfRange,
  DataLoss,
  PermissionDenied,  ///< somebody else could; asking again does not help
};

/// How long a daemon takes that goes down and comes back.
inline constexpr std::chrono::milliseconds kRestart{5000};

/// A call that cannot be granted. `reason` is UPPER_SNAKE for programs; what() is one sentence for people that says
/// what to do about it; `retry_after` says when the same call may work, where it may.
class Refusal : public std::runtime_error {
 public:
  using RetryAfter = std::optional<std::chrono::milliseconds>;

  Refusal(RefusalKind kind, std::string reason, const std::string& message, RetryAfter retry_after = std::nullopt)
      : std::runtime_error(message), kind_(kind), reason_(std::move(reason)), retry_after_(retry_after) {}

  RefusalKind kind() const { return kind_; }
  const std::string& reason() const { return reason_; }
  RetryAfter retry_after() const { return retry_after_; }

 private:
  RefusalKind kind_;
  std::string reason_;
  RetryAfter retry_after_;
};

}  // namespace saltus::server
