#include "tests/integration/server/daemon_test.h"

#include <gmock/gmock.h>

#include <thread>

namespace saltus::server {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

class JobLife : public testing_support::DaemonTest {};

TEST_F(JobLife, FromCreationToItsArtefacts) {
  start();
  const auto created_job = created();
  EXPECT_EQ(created_job.state(), v1::JOB_STATE_QUEUED);
  EXPECT_EQ(created_job.queue_position(), 1);
  EXPECT_EQ(created_job.spec().moving().format(), "nii.gz");

  const auto launch = launcher->wait_for_start(1);
  EXPECT_EQ(launch.key.job_id, created_job.id());
  v1::AcquireLeaseResponse lease;
  ASSERT_TRUE(acquire(launch, lease).ok());
  EXPECT_EQ(lease.spec().SerializeAsString(), created_job.spec().SerializeAsString());
  EXPECT_GT(lease.lease_seconds(), lease.heartbeat_interval_seconds());

  v1::HeartbeatResponse answer;
  ASSERT_TRUE(heartbeat(launch, 3, answer).ok());
  EXPECT_EQ(answer.command(), v1::HeartbeatResponse::COMMAND_CONTINUE);
  const auto running = get(created_job.id());
  EXPECT_EQ(running.state(), v1::JOB_STATE_RUNNING);
  EXPECT_EQ(running.attempt(), 1);
  EXPECT_EQ(running.progress().iteration(), 3);

  ASSERT_TRUE(succeed(launch).ok());
  const auto done = get(created_job.id());
  EXPECT_EQ(done.state(), v1::JOB_STATE_SUCCEEDED);
  ASSERT_EQ(done.artifacts_size(), 1);
  EXPECT_EQ(done.artifacts(0).name(), "displacement.nii.gz");
  EXPECT_EQ(done.artifacts(0).digest(), digest_of("field"));
  EXPECT_TRUE(done.has_start_time());
  EXPECT_TRUE(done.has_end_time());
  EXPECT_FALSE(done.has_progress());
}

TEST_F(JobLife, AFailureIsAFieldOfTheJob) {
  start();
  const auto job = created();
  auto request = as_worker<v1::CompleteJobRequest>(launcher->wait_for_start(1));
  request.mutable_failure()->set_reason("GEOMETRY_MISMATCH");
  request.mutable_failure()->set_message("the images do not overlap; check their origins");
  ASSERT_TRUE(complete(request).ok());
  EXPECT_EQ(get(job.id()).state(), v1::JOB_STATE_FAILED);
  EXPECT_EQ(get(job.id()).failure().reason(), "GEOMETRY_MISMATCH");
}

TEST_F(JobLife, ACancelReachesTheWorkerInItsHeartbeat) {
  start();
  const auto job = created();
  const auto launch = launcher->wait_for_start(1);
  EXPECT_EQ(cancel(job.id()).state(), v1::JOB_STATE_CANCELLING);
  v1::HeartbeatResponse answer;
  ASSERT_TRUE(heartbeat(launch, 1, answer).ok());
  EXPECT_EQ(answer.command(), v1::HeartbeatResponse::COMMAND_CANCEL);
  auto request = as_worker<v1::CompleteJobRequest>(launch);
  request.mutable_cancelled();
  ASSERT_TRUE(complete(request).ok());
  EXPECT_EQ(get(job.id()).state(), v1::JOB_STATE_CANCELLED);
  EXPECT_EQ(cancel(job.id()).state(), v1::JOB_STATE_CANCELLED);
}

TEST_F(JobLife, AZombieIsAborted) {
  start();
  created();
  const auto zombie = launcher->wait_for_start(1);
  launcher->end(zombie.key, {WorkerExit::Kind::Signalled, 9});
  const auto current = launcher->wait_for_start(2);
  v1::HeartbeatResponse answer;
  EXPECT_EQ(heartbeat(zombie, 1, answer).error_code(), grpc::StatusCode::ABORTED);
  EXPECT_EQ(succeed(zombie).error_code(), grpc::StatusCode::ABORTED);
  EXPECT_TRUE(succeed(current).ok());
}

TEST_F(JobLife, TheSameRequestFromManyThreadsIsOneJob) {
  start();
  auto request = valid_request();
  request.set_request_id("0b6a4b1e-0000-4000-8000-000000000001");
  constexpr int kThreads = 32;
  std::vector<v1::RegistrationJob> answers(kThreads);
  std::vector<std::thread> threads;
  for (auto& answer : answers) threads.emplace_back([&] { EXPECT_TRUE(create(request, answer).ok()); });
  for (auto& thread : threads) thread.join();
  for (const auto& answer : answers) EXPECT_EQ(answer.id(), answers[0].id());
  grpc::ClientContext listing;
  v1::ListRegistrationJobsResponse all;
  ASSERT_TRUE(jobs->ListRegistrationJobs(&listing, {}, &all).ok());
  EXPECT_EQ(all.jobs_size(), 1);

  (*request.mutable_labels())["case"] = "other";
  grpc::ClientContext context;
  v1::RegistrationJob job;
  EXPECT_EQ(jobs->CreateRegistrationJob(&context, request, &job).error_code(), grpc::StatusCode::ALREADY_EXISTS);
  EXPECT_EQ(testing_support::reason_of(context), "REQUEST_ID_REUSED");
}

TEST_F(JobLife, ListsPageByPageNewestFirst) {
  start();
  std::vector<std::string> ids;
  for (int i = 0; i < 5; ++i) ids.insert(ids.begin(), created().id());
  std::vector<std::string> listed;
  v1::ListRegistrationJobsRequest request;
  request.set_page_size(2);
  do {
    grpc::ClientContext context;
    v1::ListRegistrationJobsResponse response;
    ASSERT_TRUE(jobs->ListRegistrationJobs(&context, request, &response).ok());
    EXPECT_LE(response.jobs_size(), 2);
    for (const auto& job : response.jobs()) listed.push_back(job.id());
    request.set_page_token(response.next_page_token());
  } while (!request.page_token().empty());
  EXPECT_EQ(listed, ids);
}

TEST_F(JobLife, ListsByState) {
  start();
  const auto running = created();
  launcher->wait_for_start(1);
  const auto queued = created();
  grpc::ClientContext context;
  v1::ListRegistrationJobsRequest request;
  request.set_state(v1::JOB_STATE_QUEUED);
  v1::ListRegistrationJobsResponse response;
  ASSERT_TRUE(jobs->ListRegistrationJobs(&context, request, &response).ok());
  ASSERT_EQ(response.jobs_size(), 1);
  EXPECT_EQ(response.jobs(0).id(), queued.id());
}

TEST_F(JobLife, DeletesWhatDoesNotRunAndTheArtefactsWithIt) {
  start();
  const auto job = created();
  const auto launch = launcher->wait_for_start(1);
  EXPECT_EQ(remove(job.id()).error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  ASSERT_TRUE(succeed(launch).ok());
  ASSERT_TRUE(remove(job.id()).ok());
  EXPECT_EQ(remove(job.id()).error_code(), grpc::StatusCode::NOT_FOUND);

  grpc::ClientContext context;
  v1::FindMissingBlobsRequest request;
  request.add_digests(digest_of("field"));
  request.add_digests(digest_of("fixed"));
  v1::FindMissingBlobsResponse response;
  ASSERT_TRUE(blobs->FindMissingBlobs(&context, request, &response).ok());
  EXPECT_THAT(response.missing(), ElementsAre(digest_of("field")));
}

TEST_F(JobLife, AWatcherSeesTheSnapshotThenProgressThenTheEnd) {
  start();
  const auto job = created();
  const auto launch = launcher->wait_for_start(1);
  grpc::ClientContext context;
  v1::WatchRegistrationJobRequest request;
  request.set_id(job.id());
  const auto watch = jobs->WatchRegistrationJob(&context, request);
  v1::WatchRegistrationJobResponse event;
  ASSERT_TRUE(watch->Read(&event));
  EXPECT_EQ(event.job().state(), v1::JOB_STATE_RUNNING);

  v1::HeartbeatResponse answer;
  for (int iteration = 1; iteration <= 3; ++iteration) {
    ASSERT_TRUE(heartbeat(launch, iteration, answer).ok());
    ASSERT_TRUE(watch->Read(&event));
    EXPECT_EQ(event.job().progress().iteration(), iteration);
  }
  ASSERT_TRUE(succeed(launch).ok());
  ASSERT_TRUE(watch->Read(&event));
  EXPECT_EQ(event.job().state(), v1::JOB_STATE_SUCCEEDED);
  EXPECT_EQ(event.job().artifacts_size(), 1);
  EXPECT_FALSE(watch->Read(&event));
  EXPECT_TRUE(watch->Finish().ok());
}

TEST_F(JobLife, WatchingAFinishedJobIsOneMessage) {
  start();
  const auto job = created();
  ASSERT_TRUE(succeed(launcher->wait_for_start(1)).ok());
  grpc::ClientContext context;
  v1::WatchRegistrationJobRequest request;
  request.set_id(job.id());
  const auto watch = jobs->WatchRegistrationJob(&context, request);
  v1::WatchRegistrationJobResponse event;
  ASSERT_TRUE(watch->Read(&event));
  EXPECT_EQ(event.job().state(), v1::JOB_STATE_SUCCEEDED);
  EXPECT_FALSE(watch->Read(&event));
  EXPECT_TRUE(watch->Finish().ok());
}

TEST_F(JobLife, AWatcherOfAQueuedJobSeesItStartAndOneOfADeletedJobIsTold) {
  start();
  created();
  const auto first = launcher->wait_for_start(1);
  const auto second = created();
  const auto third = created();
  const auto watch = [&](grpc::ClientContext& context, const std::string& id) {
    v1::WatchRegistrationJobRequest request;
    request.set_id(id);
    return jobs->WatchRegistrationJob(&context, request);
  };
  grpc::ClientContext second_context, third_context;
  const auto second_watch = watch(second_context, second.id());
  const auto third_watch = watch(third_context, third.id());
  v1::WatchRegistrationJobResponse event;
  ASSERT_TRUE(second_watch->Read(&event));
  EXPECT_EQ(event.job().queue_position(), 1);
  ASSERT_TRUE(third_watch->Read(&event));
  ASSERT_TRUE(succeed(first).ok());
  ASSERT_TRUE(second_watch->Read(&event));
  EXPECT_EQ(event.job().state(), v1::JOB_STATE_RUNNING);
  ASSERT_TRUE(remove(third.id()).ok());
  EXPECT_FALSE(third_watch->Read(&event));
  EXPECT_EQ(third_watch->Finish().error_code(), grpc::StatusCode::NOT_FOUND);
  second_context.TryCancel();
  second_watch->Finish();
}

TEST_F(JobLife, WatchersBeyondTheLimitAreRefusedAndThoseThatLeaveMakeRoom) {
  start();
  const auto job = created();
  v1::WatchRegistrationJobRequest request;
  request.set_id(job.id());
  struct Watch {
    grpc::ClientContext context;
    std::unique_ptr<grpc::ClientReader<v1::WatchRegistrationJobResponse>> reader;
  };
  std::vector<std::unique_ptr<Watch>> open;
  v1::WatchRegistrationJobResponse event;
  for (int i = 0; i < 256; ++i) {
    open.push_back(std::make_unique<Watch>());
    open.back()->reader = jobs->WatchRegistrationJob(&open.back()->context, request);
    ASSERT_TRUE(open.back()->reader->Read(&event));
  }
  Watch extra;
  extra.reader = jobs->WatchRegistrationJob(&extra.context, request);
  EXPECT_FALSE(extra.reader->Read(&event));
  EXPECT_EQ(extra.reader->Finish().error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_EQ(testing_support::reason_of(extra.context), "TOO_MANY_STREAMS");
  for (auto& watch : open) {
    watch->context.TryCancel();
    watch->reader->Finish();
  }
  // The server learns of each cancel a little later.
  grpc::Status status;
  do {
    Watch again;
    again.reader = jobs->WatchRegistrationJob(&again.context, request);
    const bool is_in = again.reader->Read(&event);
    again.context.TryCancel();
    status = again.reader->Finish();
    if (is_in) break;
  } while (status.error_code() == grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_NE(status.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
}

TEST_F(JobLife, AfterACrashAWorkerThatIsStillThereFinishesItsJob) {
  start();
  const auto job = created();
  const auto launch = launcher->wait_for_start(1);
  crash();
  adoptable.insert(launch.key);
  start();
  EXPECT_EQ(get(job.id()).state(), v1::JOB_STATE_RUNNING);
  v1::HeartbeatResponse answer;
  EXPECT_TRUE(heartbeat(launch, 5, answer).ok());
  EXPECT_TRUE(succeed(launch).ok());
  EXPECT_EQ(get(job.id()).state(), v1::JOB_STATE_SUCCEEDED);
  EXPECT_EQ(get(job.id()).attempt(), 1);
}

TEST_F(JobLife, AfterACrashOfBothTheJobIsTriedAgainAndFinishes) {
  start();
  const auto job = created();
  const auto lost = launcher->wait_for_start(1);
  crash();
  start();
  const auto launch = launcher->wait_for_start(1);
  EXPECT_EQ(launch.key.job_id, job.id());
  EXPECT_EQ(launch.key.attempt, 2);
  EXPECT_EQ(succeed(lost).error_code(), grpc::StatusCode::ABORTED);
  EXPECT_TRUE(succeed(launch).ok());
  EXPECT_EQ(get(job.id()).state(), v1::JOB_STATE_SUCCEEDED);
}

TEST_F(JobLife, AnOrderlyStopQueuesTheJobAgainAndRefusesNewOnes) {
  start();
  const auto job = created();
  const auto launch = launcher->wait_for_start(1);
  const auto request = valid_request();
  std::thread stopping([&] { daemon->stop(); });
  // The worker stops because it was told to; until then the daemon answers.
  v1::RegistrationJob refused;
  grpc::Status status;
  do {
    status = create(request, refused);
  } while (status.ok());
  EXPECT_EQ(status.error_code(), grpc::StatusCode::UNAVAILABLE);
  EXPECT_THAT(status.error_message(), HasSubstr("shutting down"));
  auto stopped = as_worker<v1::CompleteJobRequest>(launch);
  stopped.mutable_cancelled();
  EXPECT_TRUE(complete(stopped).ok());
  launcher->end(launch.key, {WorkerExit::Kind::Exited, 0});
  stopping.join();
  crash();
  start();
  EXPECT_EQ(launcher->wait_for_start(1).key.job_id, job.id());
}

TEST_F(JobLife, TheNextAttemptIsToldTheLastCheckpointAndAZombieCannotChangeIt) {
  job_settings.checkpoint_interval = std::chrono::milliseconds(1500);
  start();
  const auto job = created();
  const auto first = launcher->wait_for_start(1);
  v1::AcquireLeaseResponse lease;
  ASSERT_TRUE(acquire(first, lease).ok());
  EXPECT_EQ(lease.checkpoint_interval_seconds(), 1.5);
  EXPECT_FALSE(lease.has_checkpoint());

  const auto put = [&](const LaunchRequest& launch, const std::string& content, const std::string& token) {
    grpc::ClientContext context;
    auto request = as_worker<v1::PutCheckpointRequest>(launch);
    request.set_token(token);
    request.mutable_checkpoint()->set_digest(digest_of(content));
    request.mutable_checkpoint()->set_size(static_cast<std::int64_t>(content.size()));
    request.mutable_checkpoint()->set_level(2);
    request.mutable_checkpoint()->set_iteration(7);
    v1::PutCheckpointResponse response;
    const auto status = worker->PutCheckpoint(&context, request, &response);
    return status.ok() ? "" : testing_support::reason_of(context);
  };
  EXPECT_EQ(put(first, "where it stands", first.token), "CHECKPOINT_MISSING");
  uploaded("where it stood");
  uploaded("where it stands");
  EXPECT_EQ(put(first, "where it stood", first.token), "");
  EXPECT_EQ(put(first, "where it stands", first.token), "");
  EXPECT_EQ(put(first, "where it stands", first.token), "") << "it may be repeated";
  EXPECT_EQ(put(first, "where it stood", "another token"), "LEASE_LOST");
  EXPECT_EQ(put(first, "", first.token), "INVALID_FIELD") << "no bytes";

  launcher->end(first.key, {WorkerExit::Kind::Exited, 1});
  const auto second = launcher->wait_for_start(2);
  ASSERT_TRUE(acquire(second, lease).ok());
  EXPECT_EQ(lease.checkpoint().digest(), digest_of("where it stands"));
  EXPECT_EQ(lease.checkpoint().size(), 15);
  EXPECT_EQ(lease.checkpoint().level(), 2);
  EXPECT_EQ(lease.checkpoint().iteration(), 7);
  EXPECT_EQ(put(first, "where it stood", first.token), "LEASE_LOST") << "an earlier attempt";

  ASSERT_TRUE(succeed(second).ok());
  EXPECT_EQ(put(second, "where it stands", second.token), "LEASE_LOST") << "the job has ended";
  grpc::ClientContext context;
  v1::FindMissingBlobsRequest request;
  request.add_digests(digest_of("where it stands"));
  v1::FindMissingBlobsResponse response;
  ASSERT_TRUE(blobs->FindMissingBlobs(&context, request, &response).ok());
  EXPECT_EQ(response.missing_size(), 1) << "an ended job needs no checkpoint";
}

}  // namespace
}  // namespace saltus::server
