#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace saltus::server {

/// What an error says to programs beside its code and its sentence.
struct StatusDetails {
  int code = 0;  ///< of gRPC
  std::string message;
  std::string reason;                                                ///< UPPER_SNAKE
  std::optional<std::chrono::milliseconds> retry_after;              ///< when the same call may work
  std::optional<std::pair<std::string, std::string>> invalid_field;  ///< its path, and what is wrong
  std::optional<std::string> exhausted;  ///< what there is no more of: submitter, queue, streams, disk
  std::vector<std::string> missing;      ///< digests of blobs that are not there
};

/// The bytes of the google.rpc.Status that clients of all languages find in the trailing metadata
/// `grpc-status-details-bin`: ErrorInfo with the domain "saltus", then RetryInfo, BadRequest, QuotaFailure and
/// PreconditionFailure (type MISSING) where they say something.
///
/// The standard definitions of these messages are in no Debian package for C++, so the few fields are written by hand;
/// their numbers are part of the public wire format and never change.
std::string encode(const StatusDetails& details);

}  // namespace saltus::server
