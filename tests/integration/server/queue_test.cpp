// Labels, pages, batches, priorities and what a job may use, over the wire.
#include "tests/integration/server/daemon_test.h"

#include <gmock/gmock.h>

namespace saltus::server {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing_support::reason_of;

class Queue : public testing_support::DaemonTest {
 protected:
  v1::CreateRegistrationJobRequest labelled(const std::map<std::string, std::string>& labels) {
    auto request = valid_request();
    request.mutable_labels()->insert(labels.begin(), labels.end());
    return request;
  }
  std::string id_of(const v1::CreateRegistrationJobRequest& request) {
    v1::RegistrationJob job;
    const auto status = create(request, job);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return job.id();
  }
  grpc::Status list(const v1::ListRegistrationJobsRequest& request, v1::ListRegistrationJobsResponse& response,
                    std::string* reason = nullptr) {
    grpc::ClientContext context;
    const auto status = jobs->ListRegistrationJobs(&context, request, &response);
    if (reason) *reason = reason_of(context);
    return status;
  }
  std::vector<std::string> ids(v1::ListRegistrationJobsRequest request) {
    std::vector<std::string> found;
    do {
      v1::ListRegistrationJobsResponse response;
      EXPECT_TRUE(list(request, response).ok());
      for (const auto& job : response.jobs()) found.push_back(job.id());
      request.set_page_token(response.next_page_token());
    } while (!request.page_token().empty());
    return found;
  }
  grpc::Status create_all(const v1::BatchCreateRegistrationJobsRequest& batch,
                          v1::BatchCreateRegistrationJobsResponse& response, std::string* reason = nullptr) {
    grpc::ClientContext context;
    const auto status = jobs->BatchCreateRegistrationJobs(&context, batch, &response);
    if (reason) *reason = reason_of(context);
    return status;
  }
};

TEST_F(Queue, ListsByLabelsAndSubmitterPageByPage) {
  start();
  const auto a = id_of(labelled({{"case", "7"}, {"side", "left"}}));
  const auto b = id_of(labelled({{"case", "7"}}));
  const auto c = id_of(labelled({{"case", "8"}, {"side", "left"}}));
  const auto d = id_of(labelled({{"case", "7"}, {"side", "left"}}));
  v1::ListRegistrationJobsRequest request;
  request.set_page_size(1);
  (*request.mutable_labels())["case"] = "7";
  EXPECT_THAT(ids(request), ElementsAre(d, b, a));
  (*request.mutable_labels())["side"] = "left";
  EXPECT_THAT(ids(request), ElementsAre(d, a));
  request.set_submitter("local");
  EXPECT_THAT(ids(request), ElementsAre(d, a));
  request.set_submitter("somebody else");
  EXPECT_THAT(ids(request), IsEmpty());
  EXPECT_EQ(get(c).labels().at("case"), "8");
}

TEST_F(Queue, APageTokenBelongsToItsConditions) {
  start();
  for (int i = 0; i < 2; ++i) id_of(labelled({{"case", "7"}}));
  v1::ListRegistrationJobsRequest request;
  request.set_page_size(1);
  (*request.mutable_labels())["case"] = "7";
  v1::ListRegistrationJobsResponse response;
  ASSERT_TRUE(list(request, response).ok());
  const std::string token = response.next_page_token();
  ASSERT_FALSE(token.empty());
  const auto expect_refused = [&](const v1::ListRegistrationJobsRequest& changed) {
    std::string reason;
    EXPECT_EQ(list(changed, response, &reason).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
    EXPECT_EQ(reason, "BAD_PAGE_TOKEN");
  };
  request.set_page_token(token);
  request.set_page_size(5);
  EXPECT_TRUE(list(request, response).ok()) << "another page size is no other list";
  auto changed = request;
  (*changed.mutable_labels())["case"] = "8";
  expect_refused(changed);
  changed = request;
  changed.set_state(v1::JOB_STATE_FAILED);
  expect_refused(changed);
  changed = request;
  changed.set_submitter("local");
  expect_refused(changed);
  for (const std::string& bad : {token + "0", "0" + token, std::string("1"), std::string("-1-") + token}) {
    changed = request;
    changed.set_page_token(bad);
    expect_refused(changed);
  }
}

TEST_F(Queue, ABatchIsAcceptedWholeAndOnlyOnce) {
  start();
  v1::BatchCreateRegistrationJobsRequest batch;
  for (int i = 0; i < 3; ++i) {
    auto request = valid_request();
    request.set_request_id("batch-" + std::to_string(i));
    (*request.mutable_labels())["place"] = std::to_string(i);
    *batch.add_requests() = request;
  }
  v1::BatchCreateRegistrationJobsResponse first, again;
  ASSERT_TRUE(create_all(batch, first).ok());
  ASSERT_EQ(first.jobs_size(), 3);
  for (int i = 0; i < 3; ++i) EXPECT_EQ(first.jobs(i).labels().at("place"), std::to_string(i));
  ASSERT_TRUE(create_all(batch, again).ok());
  for (int i = 0; i < 3; ++i) EXPECT_EQ(again.jobs(i).id(), first.jobs(i).id());
  EXPECT_EQ(ids({}).size(), 3u);
}

TEST_F(Queue, ABatchWithOneBadJobMakesNone) {
  start();
  v1::BatchCreateRegistrationJobsRequest batch;
  *batch.add_requests() = valid_request();
  *batch.add_requests() = valid_request();
  batch.mutable_requests(1)->mutable_spec()->mutable_fixed()->set_digest("sha256:" + std::string(64, '0'));
  v1::BatchCreateRegistrationJobsResponse response;
  std::string reason;
  EXPECT_EQ(create_all(batch, response, &reason).error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_EQ(reason, "INPUT_MISSING");
  EXPECT_THAT(ids({}), IsEmpty());

  batch.mutable_requests(1)->mutable_spec()->set_model("nonsense");
  const auto status = create_all(batch, response, &reason);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_THAT(status.error_message(), HasSubstr("requests[1]"));
  batch.clear_requests();
  EXPECT_EQ(create_all(batch, response).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  for (int i = 0; i < 101; ++i) *batch.add_requests() = valid_request();
  EXPECT_EQ(create_all(batch, response).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_THAT(ids({}), IsEmpty());
}

TEST_F(Queue, AJobSaysItsPriorityAndWhatItMayUse) {
  start();
  auto request = valid_request();
  request.set_priority(v1::JOB_PRIORITY_HIGH);
  request.mutable_resources()->set_memory_bytes(1000);
  request.mutable_resources()->set_wall_seconds_limit(60);
  request.mutable_resources()->set_cpu_seconds_limit(50);
  request.mutable_resources()->set_memory_bytes_limit(2000);
  const auto job = get(id_of(request));
  EXPECT_EQ(job.priority(), v1::JOB_PRIORITY_HIGH);
  EXPECT_EQ(job.resources().memory_bytes(), 1000);
  EXPECT_EQ(job.resources().wall_seconds_limit(), 60);
  EXPECT_EQ(job.resources().cpu_seconds_limit(), 50);
  EXPECT_EQ(job.resources().memory_bytes_limit(), 2000);
  EXPECT_EQ(job.submitter(), "local");

  const auto launch = launcher->wait_for_start(1);
  v1::AcquireLeaseResponse grant;
  ASSERT_TRUE(acquire(launch, grant).ok());
  EXPECT_EQ(grant.limits().cpu_seconds(), 50);
  EXPECT_EQ(grant.limits().memory_bytes(), 2000);
}

TEST_F(Queue, NonsenseAboutResourcesIsRefusedByName) {
  start();
  const auto refusal = [&](auto change) {
    auto request = valid_request();
    change(request);
    v1::RegistrationJob job;
    const auto status = create(request, job);
    EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
    return status.error_message();
  };
  EXPECT_THAT(refusal([](auto& request) { request.set_priority(static_cast<v1::JobPriority>(9)); }),
              HasSubstr("priority"));
  EXPECT_THAT(refusal([](auto& request) { request.mutable_resources()->set_memory_bytes(-1); }),
              HasSubstr("resources.memory_bytes is -1"));
  EXPECT_THAT(refusal([](auto& request) { request.mutable_resources()->set_wall_seconds_limit(-5); }),
              HasSubstr("resources.wall_seconds_limit is -5"));
}

TEST_F(Queue, AJobThatCanNeverRunIsRefused) {
  job_settings.memory_budget = 1 << 20;
  job_settings.thread_budget = 2;
  start();
  auto request = valid_request();
  request.mutable_resources()->set_memory_bytes((1 << 20) + 1);
  grpc::ClientContext context;
  v1::RegistrationJob job;
  EXPECT_EQ(jobs->CreateRegistrationJob(&context, request, &job).error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_EQ(reason_of(context), "EXCEEDS_BUDGET");
  request.clear_resources();
  request.mutable_spec()->set_threads(3);
  const auto status = create(request, job);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_THAT(status.error_message(), HasSubstr("3 threads"));
  grpc::ClientContext asking;
  v1::ServerInfo answer;
  ASSERT_TRUE(info->GetServerInfo(&asking, {}, &answer).ok());
  EXPECT_EQ(answer.thread_budget(), 2);
  EXPECT_EQ(answer.memory_budget_bytes(), 1 << 20);
}

TEST_F(Queue, ALostAttemptIsToldWithItsReason) {
  start();
  const auto job = created();
  launcher->end(launcher->wait_for_start(1).key, {WorkerExit::Kind::Signalled, 11});
  launcher->wait_for_start(2);
  EXPECT_EQ(get(job.id()).last_loss().reason(), "WORKER_CRASHED");
  EXPECT_THAT(get(job.id()).last_loss().message(), HasSubstr("signal 11"));
}

TEST_F(Queue, AfterARestartOrderAndLabelsAreTheSame) {
  start();
  created();
  launcher->wait_for_start(1);
  auto request = labelled({{"case", "7"}});
  const auto normal = id_of(request);
  request.set_priority(v1::JOB_PRIORITY_HIGH);
  const auto high = id_of(request);
  crash();
  start();
  EXPECT_EQ(get(high).labels().at("case"), "7");
  EXPECT_LT(get(high).queue_position(), get(normal).queue_position());
}

}  // namespace
}  // namespace saltus::server
