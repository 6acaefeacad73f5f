#include "client/lib/client_error.h"

#include <grpcpp/client_context.h>

#include <charconv>

namespace saltus::client {
namespace {

std::string trailer(const grpc::ClientContext& context, const char* key) {
  const auto& trailers = context.GetServerTrailingMetadata();
  const auto found = trailers.find(key);
  return found == trailers.end() ? "" : std::string(found->second.data(), found->second.size());
}

/// Nothing for a text that is no number: what another program says must not become a time to wait.
ClientError::RetryAfter milliseconds(const std::string& text) {
  std::int64_t count = 0;
  const auto parsed = std::from_chars(text.data(), text.data() + text.size(), count);
  if (parsed.ec != std::errc() || parsed.ptr != text.data() + text.size() || count < 0) return std::nullopt;
  return std::chrono::milliseconds(count);
}

/// A call that was refused before the daemon saw it has no trailers: its reason ends the message, as "... [REASON]".
/// Takes it from there.
std::string take_reason(std::string& message) {
  const auto begin = message.rfind(" [");
  if (begin == std::string::npos || !message.ends_with(']')) return "";
  const std::string word = message.substr(begin + 2, message.size() - begin - 3);
  if (word.empty() || word.find_first_not_of("ABCDEFGHIJKLMNOPQRSTUVWXYZ_") != std::string::npos) return "";
  message.erase(begin);
  return word;
}

}  // namespace

ClientError error_of(const grpc::Status& status, const grpc::ClientContext& context, const std::string& address) {
  const std::string reason = trailer(context, "saltus-reason");
  const auto retry_after = milliseconds(trailer(context, "saltus-retry-after-ms"));

  // Without a reason an UNAVAILABLE was made by the transport on this side; its text speaks of sockets, not of us.
  if (status.error_code() == grpc::StatusCode::UNAVAILABLE && reason.empty())
    return {status.error_code(), "SERVER_NOT_REACHABLE",
            "no saltusd answers at " + address + " (" + status.error_message() + "); is it running?"};
  if (status.error_code() == grpc::StatusCode::DEADLINE_EXCEEDED)
    return {status.error_code(), reason, "saltusd at " + address + " did not answer in time"};
  std::string message = status.error_message();
  const bool is_gate = status.error_code() == grpc::StatusCode::PERMISSION_DENIED ||
                       status.error_code() == grpc::StatusCode::UNAUTHENTICATED;
  if (is_gate && reason.empty()) {
    const std::string word = take_reason(message);
    return {status.error_code(), word, message, retry_after};
  }
  return {status.error_code(), reason, message, retry_after};
}

}  // namespace saltus::client
