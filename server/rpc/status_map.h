#pragma once

#include <grpcpp/server_context.h>
#include <grpcpp/support/status.h>

#include <exception>
#include <string>

namespace saltus::server {

/// Trailing metadata that carries the UPPER_SNAKE reason of an error.
constexpr const char* kReasonKey = "saltus-reason";
/// Trailing metadata that says after how many milliseconds the same call may work; absent when waiting does not help.
constexpr const char* kRetryKey = "saltus-retry-after-ms";

/// The one place where our errors become gRPC codes. Adds the reason and, where there is one, the time to wait to the
/// trailing metadata of `context`. What is not
/// a Refusal or InvalidInput is a fault of ours: it is logged under a number, and the client is told the number only.
grpc::Status status_of(std::exception_ptr error, grpc::CallbackServerContext& context);

/// What status_of logs faults with; standard error by default. To be set before serving.
void set_fault_log(void (*log)(const std::string& line));

}  // namespace saltus::server
