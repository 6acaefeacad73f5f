// What one submitter may have, over real connections with mutual TLS.
#include "tests/integration/server/daemon_test.h"
#include "tests/support/certificates.h"

#include <gmock/gmock.h>
#include <grpcpp/security/credentials.h>

namespace saltus::server {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using testing_support::reason_of;
using testing_support::trailer_of;

class Quotas : public testing_support::DaemonTest {
 protected:
  void SetUp() override {
    const auto certificate = authority.server();
    folder.write("server.pem", certificate.pem());
    folder.write("server.key", certificate.key_pem());
    folder.write("ca.pem", authority.root.pem());
    folder.write("roles", "ann = submitter\nbob = submitter\nreader = reader\nmachine = submitter, worker\n");
    job_settings.queue.max_queued_of_submitter = 2;
    tune = [this](DaemonSettings& settings) {
      settings.protected_listen = {{ListenAddress::Kind::Protected, "", "127.0.0.1", 0}};
      settings.tls = {folder / "server.pem", folder / "server.key", folder / "ca.pem", std::chrono::seconds(1)};
      settings.roles = folder / "roles";
      settings.upload_quota = 100;
    };
    start();
    request = valid_request();
    created();  // takes the only slot
  }

  /// From now on calls are made in this name.
  void be(const std::string& name) {
    const auto certificate = authority.issue(name);
    grpc::ChannelArguments arguments;
    arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
    arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);
    channel = grpc::CreateCustomChannel(
        daemon->protected_addresses().at(0),
        grpc::SslCredentials({authority.root.pem(), certificate.key_pem(), certificate.pem()}), arguments);
    jobs = v1::RegistrationService::NewStub(channel);
    blobs = v1::BlobService::NewStub(channel);
    info = v1::ServerInfoService::NewStub(channel);
  }
  /// "" or the reason of the refusal.
  std::string create_one() {
    grpc::ClientContext context;
    v1::RegistrationJob job;
    const auto status = jobs->CreateRegistrationJob(&context, request, &job);
    if (status.ok()) return "";
    EXPECT_EQ(status.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
    EXPECT_NE(trailer_of(context, "saltus-retry-after-ms"), "");
    EXPECT_THAT(status.error_details(), AllOf(HasSubstr("RetryInfo"), HasSubstr("QuotaFailure"), HasSubstr("QUOTA")));
    return reason_of(context);
  }
  std::string upload_one(const std::string& content) {
    std::string reason;
    upload_part(content, 0, content.size(), &reason);
    return reason;
  }

  testing_support::Authority authority;
  v1::CreateRegistrationJobRequest request;
};

TEST_F(Quotas, OfQueuedJobs) {
  be("ann");
  EXPECT_EQ(create_one(), "");
  EXPECT_EQ(create_one(), "");
  EXPECT_EQ(create_one(), "QUOTA");
  be("bob");
  EXPECT_EQ(create_one(), "") << "another's";
  connect(daemon->address());
  for (int i = 0; i < 3; ++i) EXPECT_EQ(create_one(), "") << "local callers are not told apart, so they have none";
}

TEST_F(Quotas, OfBytesThatAreOnTheServer) {
  be("ann");
  EXPECT_EQ(upload_one(std::string(60, 'a')), "");
  EXPECT_EQ(upload_one(std::string(41, 'b')), "QUOTA");
  EXPECT_EQ(upload_one(std::string(40, 'b')), "");
  EXPECT_EQ(upload_one("c"), "QUOTA");
  EXPECT_EQ(upload_one("fixed"), "") << "what is there costs nothing";
  be("bob");
  EXPECT_EQ(upload_one(std::string(60, 'c')), "");
  be("machine");
  EXPECT_EQ(upload_one(std::string(500, 'd')), "") << "a worker does what others have asked for";
  // It holds over a restart, since it is counted in rows.
  crash();
  start();
  EXPECT_EQ(upload_one(std::string(501, 'e')), "") << "a local caller";
  be("ann");
  EXPECT_EQ(upload_one("c"), "QUOTA");
}

/// Keeps what it was given to write, as a thread does that has written and not gone on yet.
class HoldingStore final : public JobStore {
 public:
  explicit HoldingStore(std::unique_ptr<JobStore> real) : real_(std::move(real)) {}
  void write(Operation operation, Done done) override {
    {
      const std::lock_guard lock(mutex_);
      held_.push_back(operation);
    }
    real_->write(std::move(operation), std::move(done));
  }
  void read(const std::function<void(JobReader&)>& operation) override { real_->read(operation); }

 private:
  std::mutex mutex_;
  std::vector<Operation> held_;
  std::unique_ptr<JobStore> real_;
};

// Whoever has the answer has the room, too: what is stored must not count once more as on its way.
TEST_F(Quotas, WhatIsStoredIsNoLongerOnItsWay) {
  crash();
  DaemonParts parts;
  parts.wrap_store = [](std::unique_ptr<JobStore> real) { return std::make_unique<HoldingStore>(std::move(real)); };
  start(std::move(parts));
  be("ann");
  EXPECT_EQ(upload_one(std::string(60, 'a')), "");
  EXPECT_EQ(upload_one(std::string(40, 'b')), "");
  EXPECT_EQ(upload_one("c"), "QUOTA");
}

TEST_F(Quotas, OfBytesOnTheirWay) {
  be("ann");
  const std::string large(80, 'a'), small(21, 'b');
  {
    grpc::ClientContext context;
    v1::WriteBlobResponse response;
    const auto writer = blobs->WriteBlob(&context, &response);
    v1::WriteBlobRequest first = announcement(large);
    first.set_data("aaa");
    ASSERT_TRUE(writer->Write(first));
    while (std::filesystem::is_empty(folder / "data/uploads")) {
    }
    EXPECT_EQ(upload_one(small), "QUOTA");
    context.TryCancel();
    writer->Finish();
  }
}

TEST_F(Quotas, OfBytesThatWaitToBeContinued) {
  be("ann");
  const std::string large(80, 'a');
  EXPECT_FALSE(upload_part(large, 0, 50).ok());
  EXPECT_EQ(write_status(large).committed_size(), 50);
  EXPECT_EQ(upload_one(std::string(51, 'b')), "QUOTA");
  EXPECT_EQ(upload_one(std::string(20, 'b')), "");
  EXPECT_TRUE(upload_part(large, 50, 30).ok()) << "its own waiting bytes do not count twice";
}

TEST_F(Quotas, OfStreams) {
  be("ann");
  // A stream has its place when it has answered; watchers do at once.
  std::vector<std::unique_ptr<grpc::ClientContext>> contexts;
  std::vector<std::unique_ptr<grpc::ClientReader<v1::WatchRegistrationJobResponse>>> watchers;
  v1::RegistrationJob job;
  ASSERT_TRUE(create(request, job).ok());
  const auto watch = [&] {
    contexts.push_back(std::make_unique<grpc::ClientContext>());
    v1::WatchRegistrationJobRequest watched;
    watched.set_id(job.id());
    watchers.push_back(jobs->WatchRegistrationJob(contexts.back().get(), watched));
    v1::WatchRegistrationJobResponse event;
    return watchers.back()->Read(&event);
  };
  v1::ServerInfo limits;
  {
    grpc::ClientContext context;
    ASSERT_TRUE(info->GetServerInfo(&context, {}, &limits).ok());
  }
  EXPECT_EQ(limits.max_queued_jobs_of_submitter(), 2);
  EXPECT_EQ(limits.max_upload_bytes_of_submitter(), 100);
  for (int i = 0; i < limits.max_watchers_of_submitter(); ++i) ASSERT_TRUE(watch()) << i;
  EXPECT_FALSE(watch());
  const auto status = watchers.back()->Finish();
  EXPECT_EQ(status.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_EQ(reason_of(*contexts.back()), "TOO_MANY_STREAMS");
  EXPECT_THAT(status.error_message(), HasSubstr("'ann'"));
  be("reader");
  EXPECT_TRUE(watch()) << "another's";
  for (auto& context : contexts) context->TryCancel();
}

// An upload_id is no secret; whoever guesses one must not touch or see the upload.
TEST_F(Quotas, AnUploadIsItsOwnersAlone) {
  const std::string content(60, 'a');
  be("ann");
  EXPECT_FALSE(upload_part(content, 0, 20).ok());
  EXPECT_EQ(write_status(content).committed_size(), 20);
  for (const char* other : {"bob", "local"}) {
    if (std::string(other) == "local")
      connect(daemon->address());
    else
      be(other);
    EXPECT_EQ(write_status(content).committed_size(), 0);
    std::string reason;
    EXPECT_EQ(upload_part(content, 20, 40, &reason).error_code(), grpc::StatusCode::ABORTED);
    EXPECT_EQ(reason, "OFFSET_MISMATCH");
    EXPECT_FALSE(upload_part(content, 0, 10).ok());
    EXPECT_EQ(write_status(content).committed_size(), 10);
  }
  be("ann");
  EXPECT_EQ(write_status(content).committed_size(), 20);
  EXPECT_TRUE(upload_part(content, 20, 40).ok());
}

// gRPC sends no metadata for calls that are refused at the gate.
TEST_F(Quotas, TheGateGivesAReasonAtTheEndOfItsSentence) {
  be("reader");
  grpc::ClientContext context;
  v1::RegistrationJob job;
  const auto status = jobs->CreateRegistrationJob(&context, request, &job);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::PERMISSION_DENIED);
  EXPECT_THAT(status.error_message(), ::testing::EndsWith(" [ROLE_LACKS_RIGHT]"));
}

}  // namespace
}  // namespace saltus::server
