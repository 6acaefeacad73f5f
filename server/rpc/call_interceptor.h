#pragma once

#include "server/rpc/authorisation.h"
#include "server/rpc/call_record.h"

#include <grpcpp/support/server_interceptor.h>

#include <memory>

namespace saltus::server {

/// Tells `observer` of every call to every service, whoever answers it; calls that the daemon makes to itself are left
/// out. Both must outlive the server.
std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface> make_call_interceptor(
    const Authorisation& authorisation, CallObserver& observer);

/// "NOT_FOUND" for NOT_FOUND.
std::string to_string(grpc::StatusCode code);

}  // namespace saltus::server
