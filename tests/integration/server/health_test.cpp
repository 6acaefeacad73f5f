// Health and reflection, which Debian has no generated code for: the messages are written as bytes.
#include "tests/integration/server/daemon_test.h"
#include "tests/integration/server/generic_call.h"
#include "tests/support/fake_disk.h"

#include <gmock/gmock.h>

namespace saltus::server {
namespace {

class Health : public testing_support::DaemonTest {
 protected:
  /// Sends one message and returns the first answer.
  std::string ask(const std::string& method, const std::string& bytes) {
    const auto answer = testing_support::call_by_name(channel, method, bytes, false);
    EXPECT_TRUE(answer.is_answered);
    EXPECT_TRUE(answer.status.ok()) << answer.status.error_message();
    return answer.bytes;
  }
};

// HealthCheckResponse{status = 1 (SERVING)}
TEST_F(Health, IsServing) {
  start();
  EXPECT_EQ(ask("/grpc.health.v1.Health/Check", ""), "\x08\x01");
}

// HealthCheckRequest{service = name}; HealthCheckResponse{status = 2 (NOT_SERVING)}
TEST_F(Health, WhatWritesIsNotServedAfterAFailureOfTheDisk) {
  const auto health_of = [this](const std::string& service) {
    return ask("/grpc.health.v1.Health/Check", "\x0a" + std::string(1, static_cast<char>(service.size())) + service);
  };
  auto disk = std::make_shared<testing_support::FakeDisk>();
  DaemonParts parts;
  parts.disk = disk;
  on_broken = [](const std::string&) {};
  start(std::move(parts));
  EXPECT_EQ(health_of("saltus.v1.BlobService"), "\x08\x01");
  disk->sync_error = EIO;
  EXPECT_EQ(upload("content", digest_of("content")).error_code(), grpc::StatusCode::UNAVAILABLE);
  // The daemon's own thread tells it, soon after the call was answered.
  while (health_of("saltus.v1.BlobService") != "\x08\x02") {
  }
  for (const char* service : {"saltus.v1.RegistrationService", "saltus.v1.WorkerService"})
    while (health_of(service) != "\x08\x02") {
    }
  EXPECT_EQ(health_of("saltus.v1.ServerInfoService"), "\x08\x01");
}

// ServerReflectionRequest{list_services = ""}
TEST_F(Health, ReflectionListsTheServices) {
  start();
  const std::string answer =
      ask("/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo", std::string("\x3a\0", 2));
  for (const char* service : {"saltus.v1.RegistrationService", "saltus.v1.BlobService", "saltus.v1.ServerInfoService",
                              "saltus.v1.WorkerService", "saltus.v1.AdminService", "grpc.health.v1.Health"})
    EXPECT_THAT(answer, ::testing::HasSubstr(service));
}

}  // namespace
}  // namespace saltus::server
