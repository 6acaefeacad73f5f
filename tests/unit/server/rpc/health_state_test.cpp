#include "server/rpc/health_state.h"

#include <gtest/gtest.h>

#include <map>

namespace saltus::server {
namespace {

class Health final : public grpc::HealthCheckServiceInterface {
 public:
  void SetServingStatus(const std::string& service, bool serves) override { is_serving[service] = serves; }
  void SetServingStatus(bool) override {}
  void Shutdown() override {}

  std::map<std::string, bool> is_serving;
};

const std::string registration = "saltus.v1.RegistrationService", blobs = "saltus.v1.BlobService",
                  worker = "saltus.v1.WorkerService", info = "saltus.v1.ServerInfoService",
                  admin = "saltus.v1.AdminService";
using Serving = std::map<std::string, bool>;

TEST(HealthState, EveryServiceServesUntilItIsSaidOtherwise) {
  Health health;
  HealthState state;
  state.attach(health);
  EXPECT_EQ(health.is_serving,
            (Serving{{"", true}, {registration, true}, {blobs, true}, {worker, true}, {info, true}, {admin, true}}));
  state.set_draining(true);
  EXPECT_EQ(health.is_serving,
            (Serving{{"", true}, {registration, false}, {blobs, true}, {worker, true}, {info, true}, {admin, true}}));
  state.set_read_only();
  EXPECT_EQ(
      health.is_serving,
      (Serving{{"", false}, {registration, false}, {blobs, false}, {worker, false}, {info, true}, {admin, true}}));
  state.set_draining(false);
  EXPECT_FALSE(health.is_serving[registration]) << "it cannot write all the same";
  state.set_not_serving();
  for (const auto& [service, serves] : health.is_serving) EXPECT_FALSE(serves) << service;
}

// A call may come before the server's object is there, or while it goes.
TEST(HealthState, WhatIsSaidBeforeTheServerIsThereHolds) {
  HealthState state;
  state.set_draining(true);
  Health health;
  state.attach(health);
  EXPECT_FALSE(health.is_serving[registration]);
  EXPECT_TRUE(health.is_serving[blobs]);
  state.detach();
  state.set_draining(false);
  EXPECT_FALSE(health.is_serving[registration]) << "it was told although it is gone";
}

}  // namespace
}  // namespace saltus::server
