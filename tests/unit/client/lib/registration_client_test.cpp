#include "client/lib/registration_client.h"

#include "tests/support/fake_daemon.h"

#include <functional>
#include <set>

namespace saltus::client {
namespace {

using testing_support::FakeDaemon;
using testing_support::TemporaryFolder;

/// Answers as scripted by the test.
class FakeRegistrations : public v1::RegistrationService::Service {
 public:
  std::function<grpc::Status(grpc::ServerContext&, const v1::CreateRegistrationJobRequest&, v1::RegistrationJob&)>
      create;
  /// Each stream sends the next list of states and ends with the status beside it.
  std::vector<std::pair<std::vector<v1::JobState>, grpc::Status>> streams;
  std::size_t streams_opened = 0;
  int jobs_there_are = 0;
  std::vector<int> page_sizes;

  grpc::Status CreateRegistrationJob(grpc::ServerContext* context, const v1::CreateRegistrationJobRequest* request,
                                     v1::RegistrationJob* job) override {
    return create(*context, *request, *job);
  }
  grpc::Status WatchRegistrationJob(grpc::ServerContext*, const v1::WatchRegistrationJobRequest* request,
                                    grpc::ServerWriter<v1::WatchRegistrationJobResponse>* writer) override {
    const auto& [states, status] = streams.at(streams_opened++);
    for (const v1::JobState state : states) {
      v1::WatchRegistrationJobResponse response;
      response.mutable_job()->set_id(request->id());
      response.mutable_job()->set_state(state);
      writer->Write(response);
    }
    return status;
  }
  grpc::Status ListRegistrationJobs(grpc::ServerContext*, const v1::ListRegistrationJobsRequest* request,
                                    v1::ListRegistrationJobsResponse* response) override {
    page_sizes.push_back(request->page_size());
    const int first = request->page_token().empty() ? 0 : std::stoi(request->page_token());
    const int last = std::min({first + request->page_size(), first + 100, jobs_there_are});
    for (int i = first; i < last; ++i) response->add_jobs()->set_id(std::to_string(i));
    if (last < jobs_there_are) response->set_next_page_token(std::to_string(last));
    return grpc::Status::OK;
  }
};

class RegistrationClientTest : public testing::Test {
 protected:
  std::vector<v1::JobState> watch() {
    std::vector<v1::JobState> seen;
    client.watch("job", [&seen](const v1::RegistrationJob& job) { seen.push_back(job.state()); });
    return seen;
  }

  FakeRegistrations service;
  FakeDaemon daemon{&service};
  RegistrationClient client{daemon.settings()};
};

TEST_F(RegistrationClientTest, RepeatsACreateWithTheSameRequestId) {
  std::vector<std::string> ids;
  service.create = [&](grpc::ServerContext&, const v1::CreateRegistrationJobRequest& request,
                       v1::RegistrationJob& job) {
    ids.push_back(request.request_id());
    if (ids.size() < 3) return grpc::Status(grpc::StatusCode::UNAVAILABLE, "later");
    job.set_id("made");
    return grpc::Status::OK;
  };
  EXPECT_EQ(client.create(v1::RegistrationSpec()).id(), "made");
  ASSERT_EQ(ids.size(), 3u);
  EXPECT_EQ(std::set(ids.begin(), ids.end()).size(), 1u);
  EXPECT_LE(ids[0].size(), 36u);
  client.create(v1::RegistrationSpec());
  EXPECT_NE(ids[3], ids[0]) << "another job must have another id";
}

TEST_F(RegistrationClientTest, PassesOnWhatTheDaemonSays) {
  service.create = [&](grpc::ServerContext& context, const v1::CreateRegistrationJobRequest&, v1::RegistrationJob&) {
    context.AddTrailingMetadata("saltus-reason", "QUEUE_FULL");
    return grpc::Status(grpc::StatusCode::RESOURCE_EXHAUSTED, "the queue is full; try again later");
  };
  try {
    client.create(v1::RegistrationSpec());
    FAIL() << "no error";
  } catch (const ClientError& error) {
    EXPECT_EQ(error.code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
    EXPECT_EQ(error.reason(), "QUEUE_FULL");
    EXPECT_STREQ(error.what(), "the queue is full; try again later");
  }
}

TEST_F(RegistrationClientTest, WatchesToTheTerminalState) {
  service.streams = {{{v1::JOB_STATE_QUEUED, v1::JOB_STATE_RUNNING, v1::JOB_STATE_SUCCEEDED}, grpc::Status::OK}};
  EXPECT_EQ(watch(), (std::vector{v1::JOB_STATE_QUEUED, v1::JOB_STATE_RUNNING, v1::JOB_STATE_SUCCEEDED}));
}

TEST_F(RegistrationClientTest, OpensABrokenWatchAgain) {
  service.streams = {{{v1::JOB_STATE_QUEUED}, grpc::Status(grpc::StatusCode::UNAVAILABLE, "restart")},
                     {{v1::JOB_STATE_RUNNING}, grpc::Status::OK},  // a daemon that shuts down in good order
                     {{v1::JOB_STATE_FAILED}, grpc::Status::OK}};
  EXPECT_EQ(watch(), (std::vector{v1::JOB_STATE_QUEUED, v1::JOB_STATE_RUNNING, v1::JOB_STATE_FAILED}));
  EXPECT_EQ(service.streams_opened, 3u);
}

TEST_F(RegistrationClientTest, EndsAWatchOfNoJob) {
  service.streams = {{{}, grpc::Status(grpc::StatusCode::NOT_FOUND, "no job")}};
  try {
    watch();
    FAIL() << "no error";
  } catch (const ClientError& error) {
    EXPECT_EQ(error.code(), grpc::StatusCode::NOT_FOUND);
  }
}

TEST_F(RegistrationClientTest, FollowsThePagesOfAList) {
  service.jobs_there_are = 250;
  EXPECT_EQ(client.list(v1::JOB_STATE_UNSPECIFIED, 230).size(), 230u);
  EXPECT_EQ(service.page_sizes, (std::vector{230, 130, 30}));
  EXPECT_EQ(client.list(v1::JOB_STATE_UNSPECIFIED, 1000).size(), 250u);
}

TEST(RegistrationClient, SaysThatNobodyAnswers) {
  TemporaryFolder folder;
  CallSettings settings{.address = "unix:" + (folder / "nobody").string(), .retry = {}, .stop = {}};
  settings.retry.patience = std::chrono::milliseconds(0);
  try {
    RegistrationClient(settings).get("job");
    FAIL() << "no error";
  } catch (const ClientError& error) {
    EXPECT_EQ(error.code(), grpc::StatusCode::UNAVAILABLE);
    EXPECT_NE(std::string(error.what()).find(settings.address), std::string::npos) << error.what();
  }
}

}  // namespace
}  // namespace saltus::client
