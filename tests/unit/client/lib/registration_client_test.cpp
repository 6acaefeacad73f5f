#include "client/lib/registration_client.h"

#include "tests/support/fake_daemon.h"

#include <functional>
#include <set>
#include <thread>

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
  v1::ListRegistrationJobsRequest last_list;
  std::vector<std::string> asked;  ///< the other calls: method and id
  int refusals = 0;                ///< so many of the other calls find the daemon unavailable first
  std::vector<v1::BatchCreateRegistrationJobsRequest> batches;

  grpc::Status GetRegistrationJob(grpc::ServerContext*, const v1::GetRegistrationJobRequest* request,
                                  v1::RegistrationJob* job) override {
    return hear("get " + request->id(), job);
  }
  grpc::Status CancelRegistrationJob(grpc::ServerContext*, const v1::CancelRegistrationJobRequest* request,
                                     v1::RegistrationJob* job) override {
    return hear("cancel " + request->id(), job);
  }
  grpc::Status DeleteRegistrationJob(grpc::ServerContext*, const v1::DeleteRegistrationJobRequest* request,
                                     v1::DeleteRegistrationJobResponse*) override {
    v1::RegistrationJob ignored;
    return hear("delete " + request->id(), &ignored);
  }
  grpc::Status BatchCreateRegistrationJobs(grpc::ServerContext*, const v1::BatchCreateRegistrationJobsRequest* request,
                                           v1::BatchCreateRegistrationJobsResponse* response) override {
    batches.push_back(*request);
    if (refusals-- > 0) return {grpc::StatusCode::UNAVAILABLE, "later"};
    for (int i = 0; i < request->requests_size(); ++i) response->add_jobs()->set_id(std::to_string(i));
    return grpc::Status::OK;
  }

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
    last_list = *request;
    const int first = request->page_token().empty() ? 0 : std::stoi(request->page_token());
    const int last = std::min({first + request->page_size(), first + 100, jobs_there_are});
    for (int i = first; i < last; ++i) response->add_jobs()->set_id(std::to_string(i));
    if (last < jobs_there_are) response->set_next_page_token(std::to_string(last));
    return grpc::Status::OK;
  }

 private:
  grpc::Status hear(const std::string& what, v1::RegistrationJob* job) {
    asked.push_back(what);
    if (refusals-- > 0) return {grpc::StatusCode::UNAVAILABLE, "later"};
    job->set_id("answer");
    return grpc::Status::OK;
  }
};

class FakeInfo : public v1::ServerInfoService::Service {
 public:
  grpc::Status GetServerInfo(grpc::ServerContext*, const v1::GetServerInfoRequest*, v1::ServerInfo* info) override {
    info->set_version("1.2.3");
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
  FakeInfo info;
  FakeDaemon daemon{&service, &info};
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

// Calls that the daemon's gate refuses come without trailers.
TEST_F(RegistrationClientTest, TakesTheReasonOfARefusalAtTheGateFromItsSentence) {
  service.create = [&](grpc::ServerContext&, const v1::CreateRegistrationJobRequest&, v1::RegistrationJob&) {
    return grpc::Status(grpc::StatusCode::PERMISSION_DENIED, "ann [7] may not do that [ROLE_LACKS_RIGHT]");
  };
  try {
    client.create(v1::RegistrationSpec());
    FAIL() << "no error";
  } catch (const ClientError& error) {
    EXPECT_EQ(error.reason(), "ROLE_LACKS_RIGHT");
    EXPECT_STREQ(error.what(), "ann [7] may not do that");
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

TEST_F(RegistrationClientTest, AsksForListsWithEveryCondition) {
  service.jobs_there_are = 150;
  v1::ListRegistrationJobsRequest request;
  request.set_state(v1::JOB_STATE_FAILED);
  request.set_submitter("ann");
  (*request.mutable_labels())["case"] = "7";
  request.set_page_size(7);  // which is seen to by the client
  EXPECT_EQ(client.list(request, 120).size(), 120u);
  EXPECT_EQ(service.page_sizes, (std::vector{120, 20}));
  EXPECT_EQ(service.last_list.state(), v1::JOB_STATE_FAILED) << "on every page";
  EXPECT_EQ(service.last_list.submitter(), "ann");
  EXPECT_EQ(service.last_list.labels().at("case"), "7");
  EXPECT_TRUE(client.list(request, 0).empty());
}

TEST_F(RegistrationClientTest, AsksForOneJobAndTriesAgainWhileNobodyAnswers) {
  service.refusals = 2;
  EXPECT_EQ(client.get("a").id(), "answer");
  EXPECT_EQ(client.cancel("b").id(), "answer");
  client.remove("c");
  EXPECT_EQ(service.asked, (std::vector<std::string>{"get a", "get a", "get a", "cancel b", "delete c"}));
}

TEST_F(RegistrationClientTest, MakesSeveralJobsAtOnceEachWithItsRequestId) {
  service.refusals = 1;
  std::vector<v1::CreateRegistrationJobRequest> requests(3);
  requests[1].set_request_id("mine");
  requests[2].set_priority(v1::JOB_PRIORITY_HIGH);
  const auto made = client.create_all(requests);
  ASSERT_EQ(made.size(), 3u);
  EXPECT_EQ(made[2].id(), "2");
  ASSERT_EQ(service.batches.size(), 2u);
  EXPECT_EQ(service.batches[0].SerializeAsString(), service.batches[1].SerializeAsString());
  const auto& sent = service.batches[1].requests();
  EXPECT_EQ(sent[1].request_id(), "mine");
  EXPECT_FALSE(sent[0].request_id().empty());
  EXPECT_NE(sent[0].request_id(), sent[2].request_id());
  EXPECT_EQ(sent[2].priority(), v1::JOB_PRIORITY_HIGH);
}

TEST_F(RegistrationClientTest, CarriesLabelsAndKeepsARequestIdThatItIsGiven) {
  v1::CreateRegistrationJobRequest seen;
  service.create = [&](grpc::ServerContext&, const v1::CreateRegistrationJobRequest& request, v1::RegistrationJob&) {
    seen = request;
    return grpc::Status::OK;
  };
  v1::RegistrationSpec spec;
  spec.set_preset("fast");
  client.create(spec, {{"case", "7"}});
  EXPECT_EQ(seen.spec().preset(), "fast");
  EXPECT_EQ(seen.labels().at("case"), "7");
  v1::CreateRegistrationJobRequest request;
  request.set_request_id("mine");
  client.create(request);
  EXPECT_EQ(seen.request_id(), "mine");
}

TEST_F(RegistrationClientTest, TellsWhatTheDaemonIs) { EXPECT_EQ(client.server_info().version(), "1.2.3"); }

// The daemon answers nothing until the test lets it.
TEST_F(RegistrationClientTest, AStopEndsACallThatIsUnderWay) {
  std::stop_source stop;
  service.create = [&](grpc::ServerContext& context, const v1::CreateRegistrationJobRequest&, v1::RegistrationJob&) {
    stop.request_stop();
    while (!context.IsCancelled()) std::this_thread::yield();
    return grpc::Status::CANCELLED;
  };
  CallSettings settings = daemon.settings();
  settings.stop = stop.get_token();
  try {
    RegistrationClient(settings).create(v1::RegistrationSpec());
    FAIL() << "no error";
  } catch (const ClientError& error) {
    EXPECT_EQ(error.code(), grpc::StatusCode::CANCELLED);
  }
}

TEST_F(RegistrationClientTest, ADaemonThatDoesNotAnswerInTimeIsNamed) {
  service.create = [&](grpc::ServerContext& context, const v1::CreateRegistrationJobRequest&, v1::RegistrationJob&) {
    while (!context.IsCancelled()) std::this_thread::yield();
    return grpc::Status::CANCELLED;
  };
  CallSettings settings = daemon.settings();
  settings.unary_deadline = std::chrono::milliseconds(50);
  try {
    RegistrationClient(settings).create(v1::RegistrationSpec());
    FAIL() << "no error";
  } catch (const ClientError& error) {
    EXPECT_EQ(error.code(), grpc::StatusCode::DEADLINE_EXCEEDED);
    EXPECT_NE(std::string(error.what()).find(settings.address), std::string::npos) << error.what();
  }
}

TEST(RegistrationClient, KnowsTheStatesThatNeverChange) {
  for (const auto state : {v1::JOB_STATE_SUCCEEDED, v1::JOB_STATE_FAILED, v1::JOB_STATE_CANCELLED})
    EXPECT_TRUE(is_terminal(state));
  for (const auto state :
       {v1::JOB_STATE_UNSPECIFIED, v1::JOB_STATE_QUEUED, v1::JOB_STATE_RUNNING, v1::JOB_STATE_CANCELLING})
    EXPECT_FALSE(is_terminal(state));
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
