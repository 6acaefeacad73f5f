#include "server/rpc/status_map.h"

#include "core/support/errors.h"
#include "server/jobs/refusal.h"

#include <atomic>
#include <cstdio>

namespace saltus::server {
namespace {

std::atomic<void (*)(const std::string&)> fault_log{
    [](const std::string& line) { std::fprintf(stderr, "%s\n", line.c_str()); }};
std::atomic<int> fault_count{0};

grpc::StatusCode code_of(RefusalKind kind) {
  switch (kind) {
    case RefusalKind::InvalidArgument:
      return grpc::StatusCode::INVALID_ARGUMENT;
    case RefusalKind::NotFound:
      return grpc::StatusCode::NOT_FOUND;
    case RefusalKind::AlreadyExists:
      return grpc::StatusCode::ALREADY_EXISTS;
    case RefusalKind::FailedPrecondition:
      return grpc::StatusCode::FAILED_PRECONDITION;
    case RefusalKind::Exhausted:
      return grpc::StatusCode::RESOURCE_EXHAUSTED;
    case RefusalKind::Unavailable:
      return grpc::StatusCode::UNAVAILABLE;
    case RefusalKind::Aborted:
      return grpc::StatusCode::ABORTED;
    case RefusalKind::OutOfRange:
      return grpc::StatusCode::OUT_OF_RANGE;
    case RefusalKind::DataLoss:
      return grpc::StatusCode::DATA_LOSS;
    case RefusalKind::PermissionDenied:
      return grpc::StatusCode::PERMISSION_DENIED;
  }
  return grpc::StatusCode::INTERNAL;
}

grpc::Status fault(const std::string& what, grpc::CallbackServerContext& context) {
  const std::string number = std::to_string(++fault_count);
  fault_log.load()("internal fault " + number + ": " + what);
  context.AddTrailingMetadata(kReasonKey, "INTERNAL");
  return {grpc::StatusCode::INTERNAL, "internal fault " + number + " of the daemon; its log says more"};
}

}  // namespace

void set_fault_log(void (*log)(const std::string& line)) { fault_log = log; }

grpc::Status status_of(std::exception_ptr error, grpc::CallbackServerContext& context) {
  if (!error) return grpc::Status::OK;
  try {
    std::rethrow_exception(error);
  } catch (const Refusal& refusal) {
    context.AddTrailingMetadata(kReasonKey, refusal.reason());
    if (refusal.retry_after()) context.AddTrailingMetadata(kRetryKey, std::to_string(refusal.retry_after()->count()));
    return {code_of(refusal.kind()), refusal.what()};
  } catch (const InvalidInput& invalid) {
    context.AddTrailingMetadata(kReasonKey, "INVALID_FIELD");
    return {grpc::StatusCode::INVALID_ARGUMENT, invalid.what()};
  } catch (const std::exception& other) {
    return fault(other.what(), context);
  } catch (...) {
    return fault("unknown exception", context);
  }
}

}  // namespace saltus::server
