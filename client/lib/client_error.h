#pragma once

#include <grpcpp/support/status.h>

#include <chrono>
#include <optional>
#include <stdexcept>
#include <string>

namespace grpc {
class ClientContext;
}

namespace saltus::client {

/// A call to the daemon that did not succeed.
///
/// `code` says how to act: UNAVAILABLE (not reachable, retries are over), CANCELLED (the caller's stop token),
/// everything else as the comments of proto/saltus/v1 list them. `reason` is the daemon's UPPER_SNAKE word for
/// programs, "" when it gave none. `retry_after` is the daemon's estimate of when the same call may work; nothing when
/// waiting does not help. what() is one sentence for people.
class ClientError : public std::runtime_error {
 public:
  using RetryAfter = std::optional<std::chrono::milliseconds>;

  ClientError(grpc::StatusCode code, std::string reason, const std::string& message,
              RetryAfter retry_after = std::nullopt)
      : std::runtime_error(message), code_(code), reason_(std::move(reason)), retry_after_(retry_after) {}

  grpc::StatusCode code() const { return code_; }
  const std::string& reason() const { return reason_; }
  RetryAfter retry_after() const { return retry_after_; }

 private:
  grpc::StatusCode code_;
  std::string reason_;
  RetryAfter retry_after_;
};

/// A file on this side could not be read or written. The message names the file and the reason.
class LocalFileError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// The error that a finished call of `context` amounts to. `address` is named where the daemon did not answer.
ClientError error_of(const grpc::Status& status, const grpc::ClientContext& context, const std::string& address);

}  // namespace saltus::client
