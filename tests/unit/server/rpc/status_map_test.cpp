#include "server/rpc/status_map.h"

#include "core/support/errors.h"
#include "server/jobs/refusal.h"

#include <gtest/gtest.h>

namespace saltus::server {
namespace {

std::string logged;

template <class Error>
grpc::Status status_of_error(const Error& error) {
  grpc::CallbackServerContext context;
  return status_of(std::make_exception_ptr(error), context);
}

TEST(StatusMap, EveryRefusalHasItsCode) {
  const std::pair<RefusalKind, grpc::StatusCode> table[] = {
      {RefusalKind::InvalidArgument, grpc::StatusCode::INVALID_ARGUMENT},
      {RefusalKind::NotFound, grpc::StatusCode::NOT_FOUND},
      {RefusalKind::AlreadyExists, grpc::StatusCode::ALREADY_EXISTS},
      {RefusalKind::FailedPrecondition, grpc::StatusCode::FAILED_PRECONDITION},
      {RefusalKind::Exhausted, grpc::StatusCode::RESOURCE_EXHAUSTED},
      {RefusalKind::Unavailable, grpc::StatusCode::UNAVAILABLE},
      {RefusalKind::Aborted, grpc::StatusCode::ABORTED},
      {RefusalKind::OutOfRange, grpc::StatusCode::OUT_OF_RANGE},
      {RefusalKind::DataLoss, grpc::StatusCode::DATA_LOSS},
      {RefusalKind::PermissionDenied, grpc::StatusCode::PERMISSION_DENIED},
  };
  for (const auto& [kind, code] : table) {
    const auto status = status_of_error(Refusal(kind, "REASON", "what and how"));
    EXPECT_EQ(status.error_code(), code);
    EXPECT_EQ(status.error_message(), "what and how");
  }
  EXPECT_EQ(status_of_error(InvalidInput("x")).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
}

TEST(StatusMap, AFaultOfOursIsLoggedAndNotTold) {
  set_fault_log([](const std::string& line) { logged = line; });
  const auto status = status_of_error(std::runtime_error("/secret/path"));
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INTERNAL);
  EXPECT_EQ(status.error_message().find("secret"), std::string::npos);
  EXPECT_NE(logged.find("/secret/path"), std::string::npos);
}

}  // namespace
}  // namespace saltus::server
