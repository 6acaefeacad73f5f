#include "client/lib/client_error.h"

#include <grpcpp/client_context.h>

namespace saltus::client {

ClientError error_of(const grpc::Status& status, const grpc::ClientContext& context, const std::string& address) {
  std::string reason;
  const auto& trailers = context.GetServerTrailingMetadata();
  if (const auto found = trailers.find("saltus-reason"); found != trailers.end())
    reason.assign(found->second.data(), found->second.size());

  // Without a reason an UNAVAILABLE was made by the transport on this side; its text speaks of sockets, not of us.
  if (status.error_code() == grpc::StatusCode::UNAVAILABLE && reason.empty())
    return {status.error_code(), "SERVER_NOT_REACHABLE",
            "no saltusd answers at " + address + " (" + status.error_message() + "); is it running?"};
  if (status.error_code() == grpc::StatusCode::DEADLINE_EXCEEDED)
    return {status.error_code(), reason, "saltusd at " + address + " did not answer in time"};
  return {status.error_code(), reason, status.error_message()};
}

}  // namespace saltus::client
