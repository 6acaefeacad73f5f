// Attempts whose worker waits in the queue of a batch system.
#include "tests/unit/server/jobs/job_manager_fixture.h"

#include <gmock/gmock.h>

namespace saltus::server {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

class BatchAttempts : public JobManagerTest {
 protected:
  BatchAttempts() { use_batch_system(); }

  void use_batch_system() {
    manager.reset();
    launcher = std::make_unique<testing_support::FakeLauncher>();
    launcher->is_batch = true;
    make_manager_of_launcher();
  }
  LaunchRequest submit_with(const JobLimits& limits) {
    NewJob job;
    job.limits = limits;
    submit(job);
    settle();
    return launcher->started().back();
  }
  JobRecord row(const LaunchRequest& request) { return *store.table.find(request.key.job_id); }
  JobStage stage(const LaunchRequest& request) {
    const JobView view = manager->get(request.key.job_id);
    return view.progress ? view.progress->stage : JobStage::Unknown;
  }
  void settle_after(std::chrono::milliseconds time) {
    clock.advance(time);
    settle();
  }
};

TEST_F(BatchAttempts, OneThatWaitsForItsTurnLosesNothingHoweverLongThatTakes) {
  const auto request = submit_with({.wall_seconds = 60});
  EXPECT_EQ(stage(request), JobStage::Waiting);
  settle_after(48h);
  EXPECT_EQ(row(request).state, JobState::Running);
  EXPECT_EQ(row(request).attempt, 1);
  EXPECT_FALSE(row(request).begun);

  manager->acquire(request.key, request.token);
  EXPECT_EQ(row(request).begun, clock.wall());
  EXPECT_EQ(stage(request), JobStage::Unknown);
  for (int second = 0; second < 59; ++second) {
    manager->heartbeat(request.key, request.token, {.iteration = second});
    settle_after(1s);
  }
  EXPECT_EQ(row(request).state, JobState::Running);
  settle_after(1s);
  EXPECT_EQ(row(request).state, JobState::Failed);
  EXPECT_EQ(row(request).failure->reason, "WALL_TIME");
}

TEST_F(BatchAttempts, OnceBegunTheLeaseRunsAsAnyOther) {
  const auto request = submit_with({});
  settle_after(1h);
  manager->acquire(request.key, request.token);
  settle_after(30s);
  EXPECT_EQ(row(request).last_loss->reason, "LEASE_EXPIRED");
  EXPECT_EQ(row(request).state, JobState::Queued);
}

TEST_F(BatchAttempts, AWorkerThatHasItsTurnAndDoesNotCallIsGivenUp) {
  const auto request = submit_with({});
  settle_after(1h);
  launcher->tell(request.key, {"17", true});
  EXPECT_EQ(row(request).batch_id, "17");
  EXPECT_EQ(stage(request), JobStage::Unknown);
  settle_after(settings.first_call - 1ms);
  EXPECT_EQ(row(request).state, JobState::Running);
  settle_after(1ms);
  EXPECT_EQ(row(request).last_loss->reason, "LEASE_EXPIRED");
  EXPECT_THAT(launcher->killed(), ElementsAre(request.key));
}

TEST_F(BatchAttempts, ItsNameIsKnownBeforeItIsStarted) {
  launcher->refuse_starts = true;
  submit();
  manager->tick();
  const JobRecord job = store.table.list({}, 1000, 1).front();
  EXPECT_EQ(job.state, JobState::Running);
  EXPECT_EQ(job.process, "process of " + job.id + " 1");
}

TEST_F(BatchAttempts, ARestartLeavesThemWaitingAndRunning) {
  slots = 2;
  use_batch_system();
  const auto waiting = submit_with({.wall_seconds = 60});
  const auto running = submit_with({.wall_seconds = 60});
  manager->acquire(running.key, running.token);
  clock.advance(10s);
  manager->begin_drain();
  EXPECT_TRUE(manager->is_drained());
  EXPECT_THAT(launcher->terminated(), IsEmpty());
  settle_after(settings.drain_grace);
  EXPECT_THAT(launcher->killed(), IsEmpty());

  clock.advance(-settings.drain_grace);
  use_batch_system();
  launcher->adoptable = {waiting.key, running.key};
  manager->recover();
  EXPECT_EQ(stage(waiting), JobStage::Waiting);
  settle_after(29s);
  manager->heartbeat(running.key, running.token, {.iteration = 1});
  settle_after(20s);
  EXPECT_EQ(row(waiting).state, JobState::Running);
  EXPECT_EQ(row(running).state, JobState::Running);
  // 10 s before the restart and 49 s after it.
  settle_after(1s);
  EXPECT_EQ(row(running).failure->reason, "WALL_TIME");
  EXPECT_EQ(row(waiting).attempt, 1);
}

TEST_F(BatchAttempts, TheFirstCallAfterARestartBeginsWhatBeganMeanwhile) {
  const auto request = submit_with({});
  use_batch_system();
  launcher->adoptable = {request.key};
  manager->recover();
  clock.advance(1h);
  manager->heartbeat(request.key, request.token, {.stage = JobStage::Optimising});
  EXPECT_EQ(row(request).begun, clock.wall());
  EXPECT_EQ(stage(request), JobStage::Optimising);
}

TEST_F(BatchAttempts, ACancelDoesNotWaitForAWorkerThatIsNotThere) {
  const auto request = submit_with({});
  cancel(request.key.job_id);
  settle();
  EXPECT_THAT(launcher->terminated(), ElementsAre(request.key));
  launcher->end(request.key, {WorkerExit::Kind::Withdrawn});
  EXPECT_EQ(row(request).state, JobState::Cancelled);
}

TEST_F(BatchAttempts, ASecondProcessWithTheSameTokenIsSentAway) {
  const auto request = submit_with({});
  manager->acquire(request.key, request.token, "one");
  EXPECT_THROW(manager->acquire(request.key, request.token, "two"), Refusal);
  EXPECT_NO_THROW(manager->acquire(request.key, request.token, "one"));
}

TEST_F(BatchAttempts, TheTimeLimitOfTheBatchSystemIsTheJobsOwnWhenItHasOne) {
  const auto limited = submit_with({.wall_seconds = 60});
  launcher->end(limited.key, {WorkerExit::Kind::TimeLimit});
  EXPECT_EQ(row(limited).failure->reason, "WALL_TIME");
  const auto unlimited = submit_with({});
  launcher->end(unlimited.key, {WorkerExit::Kind::TimeLimit});
  EXPECT_EQ(row(unlimited).state, JobState::Queued);
  EXPECT_EQ(row(unlimited).last_loss->reason, "BATCH_TIME_LIMIT");
  EXPECT_EQ(row(unlimited).lost_attempts, 1);
}

TEST_F(BatchAttempts, PreemptionCostsNoAttempt) {
  submit_with({});
  for (int round = 1; round <= 5; ++round) {
    const auto request = launcher->started().back();
    EXPECT_EQ(request.key.attempt, round);
    launcher->end(request.key, {WorkerExit::Kind::Preempted});
    EXPECT_EQ(row(request).state, JobState::Queued);
    EXPECT_EQ(row(request).lost_attempts, 0);
    wait_for_retry();
  }
}

TEST_F(BatchAttempts, WhatTheBatchSystemDidIsTold) {
  for (const auto& [kind, reason] : {std::pair(WorkerExit::Kind::NodeFailed, "NODE_FAILED"),
                                     {WorkerExit::Kind::Withdrawn, "BATCH_CANCELLED"},
                                     {WorkerExit::Kind::Refused, "LAUNCH_FAILED"},
                                     {WorkerExit::Kind::Vanished, "WORKER_VANISHED"}}) {
    const auto request = submit_with({});
    launcher->end(request.key, {kind, 0, "no such partition"});
    EXPECT_EQ(row(request).state, JobState::Queued);
    EXPECT_EQ(row(request).last_loss->reason, reason);
    EXPECT_EQ(row(request).lost_attempts, 1);
    manager->cancel(request.key.job_id, [](std::exception_ptr, const JobView&) {});
  }
}

TEST_F(BatchAttempts, WhyItWaitsIsShownUntilItBegins) {
  const auto request = submit_with({});
  const auto waiting_for = [&] {
    const JobView view = manager->get(request.key.job_id);
    return view.progress ? view.progress->waiting_for : "-";
  };
  launcher->tell(request.key, {"17", false, "", "Resources"});
  EXPECT_EQ(stage(request), JobStage::Waiting);
  EXPECT_EQ(waiting_for(), "Resources");
  launcher->tell({request.key.job_id, 7}, {"18", false, "", "of another attempt"});
  launcher->tell(request.key, {"17", false, "", "Priority"});
  EXPECT_EQ(waiting_for(), "Priority");
  launcher->tell({request.key.job_id, 7}, {"18", false, "", "of another attempt"});
  EXPECT_EQ(waiting_for(), "Priority");
  launcher->tell(request.key, {"17", true, "node3", ""});
  EXPECT_EQ(waiting_for(), "-");
}

TEST_F(BatchAttempts, OneThatCanNeverStartFailsAtOnceWithWhatItAsksFor) {
  NewJob job;
  job.threads = 64;
  job.memory_bytes = std::int64_t{3} << 30;
  job.limits.wall_seconds = 7200;
  submit(job);
  settle();
  const auto request = launcher->started().back();
  launcher->end(request.key, {WorkerExit::Kind::NeverStarts, 0, "PartitionTimeLimit"});
  const JobRecord failed = row(request);
  EXPECT_EQ(failed.state, JobState::Failed);
  EXPECT_EQ(failed.attempt, 1);
  ASSERT_TRUE(failed.failure);
  EXPECT_EQ(failed.failure->reason, "BATCH_NEVER_STARTS");
  for (const char* text : {"PartitionTimeLimit", "64 threads", "3.0 GiB", "7200 s"})
    EXPECT_THAT(failed.failure->message, ::testing::HasSubstr(text));
}

TEST_F(BatchAttempts, ALaterAttemptHasNothingOfTheOneBefore) {
  const auto first = submit_with({});
  launcher->tell(first.key, {"17", true, "node3"});
  manager->acquire(first.key, first.token);
  launcher->end(first.key, {WorkerExit::Kind::NodeFailed});
  EXPECT_EQ(row(first).batch_id, "17");
  EXPECT_EQ(row(first).last_loss->message, "the worker's machine failed (batch job 17 on node3)");
  wait_for_retry();
  EXPECT_EQ(row(first).attempt, 2);
  EXPECT_EQ(row(first).batch_id, "");
  EXPECT_EQ(row(first).batch_host, "");
  EXPECT_FALSE(row(first).begun);
  launcher->tell(first.key, {"18", true});
  EXPECT_EQ(row(first).batch_id, "");
}

}  // namespace
}  // namespace saltus::server
