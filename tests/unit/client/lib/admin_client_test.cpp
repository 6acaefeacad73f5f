#include "client/lib/admin_client.h"

#include "client/lib/client_error.h"
#include "tests/support/fake_daemon.h"

#include <gtest/gtest.h>

namespace saltus::client {
namespace {

/// Answers as scripted by the test.
class FakeAdmin : public v1::AdminService::Service {
 public:
  int refusals = 0;  ///< so many calls find the daemon unavailable first
  bool was_resume = false;
  std::vector<v1::FsckResponse> findings;
  grpc::Status end_of_check;
  int checks = 0;

  grpc::Status Drain(grpc::ServerContext*, const v1::DrainRequest* request, v1::DrainResponse* response) override {
    if (refusals-- > 0) return {grpc::StatusCode::UNAVAILABLE, "later"};
    was_resume = request->resume();
    response->set_is_draining(!request->resume());
    response->set_queued_jobs(7);
    return grpc::Status::OK;
  }
  grpc::Status CollectGarbage(grpc::ServerContext* context, const v1::CollectGarbageRequest*,
                              v1::CollectGarbageResponse* response) override {
    has_deadline = context->deadline() < std::chrono::system_clock::now() + std::chrono::hours(24);
    response->set_blobs(3);
    return grpc::Status::OK;
  }
  grpc::Status Fsck(grpc::ServerContext*, const v1::FsckRequest*,
                    grpc::ServerWriter<v1::FsckResponse>* writer) override {
    ++checks;
    if (refusals-- > 0) return {grpc::StatusCode::UNAVAILABLE, "later"};
    for (const v1::FsckResponse& finding : findings) writer->Write(finding);
    return end_of_check;
  }
  bool has_deadline = true;
};

class AdminClientTest : public testing::Test {
 protected:
  FakeAdmin service;
  testing_support::FakeDaemon daemon{&service};
  AdminClient client{daemon.settings()};
};

TEST_F(AdminClientTest, DrainsAndTakesItBack) {
  service.refusals = 2;
  const auto drained = client.drain(false);
  EXPECT_TRUE(drained.is_draining());
  EXPECT_EQ(drained.queued_jobs(), 7);
  EXPECT_FALSE(service.was_resume);
  EXPECT_FALSE(client.drain(true).is_draining());
  EXPECT_TRUE(service.was_resume);
}

TEST_F(AdminClientTest, CollectsGarbageForAsLongAsItTakes) {
  EXPECT_EQ(client.collect_garbage().blobs(), 3);
  EXPECT_FALSE(service.has_deadline);
}

TEST_F(AdminClientTest, TellsEachFindingOfACheckAndReturnsTheLast) {
  service.refusals = 1;
  for (int i = 1; i <= 3; ++i) service.findings.emplace_back().set_blobs(i);
  service.findings.back().set_is_done(true);
  std::vector<std::int64_t> told;
  const auto last = client.fsck([&](const v1::FsckResponse& response) { told.push_back(response.blobs()); });
  EXPECT_EQ(told, (std::vector<std::int64_t>{1, 2, 3}));
  EXPECT_TRUE(last.is_done());
  EXPECT_EQ(service.checks, 2) << "one that has not begun is begun again";
}

TEST_F(AdminClientTest, ACheckThatIsCutIsNotBegunAgain) {
  service.findings.emplace_back().set_blobs(1);
  service.end_of_check = {grpc::StatusCode::UNAVAILABLE, "the daemon goes down"};
  try {
    client.fsck([](const v1::FsckResponse&) {});
    FAIL() << "no error";
  } catch (const ClientError& error) {
    EXPECT_EQ(error.code(), grpc::StatusCode::ABORTED);
    EXPECT_NE(std::string(error.what()).find("was cut off"), std::string::npos);
  }
  EXPECT_EQ(service.checks, 1);
}

}  // namespace
}  // namespace saltus::client
