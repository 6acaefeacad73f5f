#include "server/rpc/status_map.h"

#include "core/support/errors.h"
#include "server/jobs/input_refusal.h"
#include "server/jobs/refusal.h"
#include "server/rpc/invalid_field.h"
#include "server/rpc/status_details.h"

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

StatusDetails fault(const std::string& what) {
  const std::string number = std::to_string(++fault_count);
  fault_log.load()("internal fault " + number + ": " + what);
  StatusDetails details;
  details.code = grpc::StatusCode::INTERNAL;
  details.reason = "INTERNAL";
  details.message = "internal fault " + number + " of the daemon; its log says more";
  return details;
}

/// Whose measure is full.
std::string subject_of(const std::string& reason) {
  if (reason == "QUOTA") return "submitter";
  if (reason == "QUEUE_FULL") return "queue";
  if (reason == "TOO_MANY_STREAMS") return "streams";
  if (reason == "STORAGE_FULL") return "disk";
  return "daemon";
}

StatusDetails details_of(const Refusal& refusal) {
  StatusDetails details;
  details.code = code_of(refusal.kind());
  details.reason = refusal.reason();
  details.message = refusal.what();
  details.retry_after = refusal.retry_after();
  if (refusal.kind() == RefusalKind::Exhausted) details.exhausted = subject_of(refusal.reason());
  return details;
}

StatusDetails details_of(const InvalidInput& invalid) {
  StatusDetails details;
  details.code = grpc::StatusCode::INVALID_ARGUMENT;
  details.reason = "INVALID_FIELD";
  details.message = invalid.what();
  return details;
}

StatusDetails details_of(std::exception_ptr error) {
  try {
    std::rethrow_exception(error);
  } catch (const MissingInputs& missing) {
    StatusDetails details = details_of(static_cast<const Refusal&>(missing));
    details.missing = missing.digests();
    return details;
  } catch (const Refusal& refusal) {
    return details_of(refusal);
  } catch (const InvalidField& invalid) {
    StatusDetails details = details_of(static_cast<const InvalidInput&>(invalid));
    details.invalid_field.emplace(invalid.field(), invalid.what());
    return details;
  } catch (const InvalidInput& invalid) {
    return details_of(invalid);
  } catch (const std::exception& other) {
    return fault(other.what());
  } catch (...) {
    return fault("unknown exception");
  }
}

}  // namespace

void set_fault_log(void (*log)(const std::string& line)) { fault_log = log; }

grpc::Status status_of(std::exception_ptr error, grpc::CallbackServerContext& context) {
  if (!error) return grpc::Status::OK;
  const StatusDetails details = details_of(error);
  context.AddTrailingMetadata(kReasonKey, details.reason);
  if (details.retry_after) context.AddTrailingMetadata(kRetryKey, std::to_string(details.retry_after->count()));
  return {static_cast<grpc::StatusCode>(details.code), details.message, encode(details)};
}

}  // namespace saltus::server
