// Drain, garbage collection and fsck as an administrator calls them.
#include "tests/integration/server/daemon_test.h"

#include "saltus/v1/admin.grpc.pb.h"

#include <gmock/gmock.h>

#include <fstream>

namespace saltus::server {
namespace {

class Administration : public testing_support::DaemonTest {
 protected:
  void begin(DaemonParts parts = {}) {
    start(std::move(parts));
    admin = v1::AdminService::NewStub(channel);
  }
  v1::DrainResponse drain(bool resume) {
    grpc::ClientContext context;
    v1::DrainRequest request;
    request.set_resume(resume);
    v1::DrainResponse response;
    EXPECT_TRUE(admin->Drain(&context, request, &response).ok());
    return response;
  }
  v1::CollectGarbageResponse collect() {
    grpc::ClientContext context;
    v1::CollectGarbageResponse response;
    EXPECT_TRUE(admin->CollectGarbage(&context, {}, &response).ok());
    return response;
  }
  v1::FsckResponse fsck(std::vector<v1::FsckFinding>& findings) {
    grpc::ClientContext context;
    const auto reader = admin->Fsck(&context, {});
    v1::FsckResponse response;
    while (reader->Read(&response))
      findings.insert(findings.end(), response.findings().begin(), response.findings().end());
    EXPECT_TRUE(reader->Finish().ok());
    EXPECT_TRUE(response.is_done());
    return response;
  }
  bool is_draining() {
    grpc::ClientContext context;
    v1::ServerInfo answer;
    EXPECT_TRUE(info->GetServerInfo(&context, {}, &answer).ok());
    EXPECT_TRUE(answer.has_is_draining());
    return answer.is_draining();
  }
  std::unique_ptr<v1::AdminService::Stub> admin;
};

TEST_F(Administration, ADrainRefusesAndStartsNothingUntilItIsTakenBack) {
  begin();
  const auto running = created();
  const auto launch = launcher->wait_for_start(1);
  const auto waiting = created();
  const auto request = valid_request();
  EXPECT_FALSE(is_draining());
  const auto drained = drain(false);
  EXPECT_TRUE(drained.is_draining());
  EXPECT_TRUE(is_draining());
  EXPECT_EQ(drained.running_jobs(), 1);
  EXPECT_EQ(drained.queued_jobs(), 1);
  grpc::ClientContext context;
  v1::RegistrationJob refused;
  EXPECT_EQ(jobs->CreateRegistrationJob(&context, request, &refused).error_code(), grpc::StatusCode::UNAVAILABLE);
  EXPECT_EQ(testing_support::reason_of(context), "DRAINING");
  // What runs ends as always, and its place stays free.
  EXPECT_TRUE(succeed(launch).ok());
  EXPECT_EQ(get(running.id()).state(), v1::JOB_STATE_SUCCEEDED);
  EXPECT_EQ(drain(false).running_jobs(), 0);
  EXPECT_EQ(get(waiting.id()).state(), v1::JOB_STATE_QUEUED);
  EXPECT_EQ(launcher->started().size(), 1u);
  EXPECT_FALSE(drain(true).is_draining());
  EXPECT_EQ(launcher->wait_for_start(2).key.job_id, waiting.id());
}

TEST_F(Administration, GarbageIsCollectedWhenAsked) {
  auto clock = std::make_shared<testing_support::FakeClock>();
  DaemonParts parts;
  parts.clock = clock;
  begin(std::move(parts));
  const std::string digest = uploaded("nobody needs this");
  EXPECT_FALSE(upload_part("half", 0, 2).ok());
  EXPECT_EQ(collect().blobs(), 0);
  clock->advance(std::chrono::hours(7 * 24) + std::chrono::milliseconds(1));
  const auto report = collect();
  EXPECT_EQ(report.blobs(), 1);
  EXPECT_EQ(report.blob_bytes(), 17);
  EXPECT_EQ(report.uploads(), 1);
  EXPECT_EQ(report.upload_bytes(), 2);
  grpc::ClientContext context;
  v1::ReadBlobRequest request;
  request.set_digest(digest);
  EXPECT_EQ(blobs->ReadBlob(&context, request)->Finish().error_code(), grpc::StatusCode::NOT_FOUND);
}

TEST_F(Administration, TheStoreIsCheckedBesideTheService) {
  begin();
  const std::string sound = uploaded(std::string(3000000, 's'));
  const std::string damaged = uploaded(std::string(3000000, 'd'));
  std::vector<v1::FsckFinding> findings;
  auto report = fsck(findings);
  EXPECT_EQ(report.blobs(), 2);
  EXPECT_EQ(report.bytes(), 6000000);
  EXPECT_TRUE(findings.empty());
  {
    std::fstream file(folder / "data/blobs/sha256" / damaged.substr(7, 2) / damaged.substr(9),
                      std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(2999999);
    file.put('!');
  }
  report = fsck(findings);
  EXPECT_EQ(report.corrupt(), 1);
  EXPECT_EQ(report.set_aside(), 1);
  ASSERT_EQ(findings.size(), 1u);
  EXPECT_EQ(findings[0].digest(), damaged);
  EXPECT_EQ(findings[0].kind(), v1::FsckFinding::KIND_CORRUPT);
  uploaded(std::string(3000000, 'd'));
  findings.clear();
  EXPECT_EQ(fsck(findings).missing(), 0);
  EXPECT_TRUE(findings.empty());
}

}  // namespace
}  // namespace saltus::server
