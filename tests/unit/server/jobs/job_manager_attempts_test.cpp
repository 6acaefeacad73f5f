#include "tests/unit/server/jobs/job_manager_fixture.h"

#include <gmock/gmock.h>

namespace saltus::server {
namespace {

using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

TEST_F(JobManagerTest, ASilentWorkerLosesItsJobAndIsKilled) {
  const auto worker = submit_and_launch();
  clock.advance(30s);
  settle();
  EXPECT_THAT(launcher->killed(), Contains(worker.key));
  launcher->end(worker.key, {WorkerExit::Kind::Signalled, 9});
  wait_for_retry();
  EXPECT_EQ(launcher->started().back().key.attempt, 2);
  EXPECT_THROW(manager->heartbeat(worker.key, worker.token, {}), Refusal);
}

TEST_F(JobManagerTest, TheDeathOfAWorkerKilledForItsSilenceIsNoCrash) {
  const auto worker = submit_and_launch();
  clock.advance(30s);
  settle();
  launcher->end(worker.key, {WorkerExit::Kind::Signalled, 9});
  EXPECT_EQ(store.table.find(worker.key.job_id)->crashes, 0);
  EXPECT_EQ(store.table.find(worker.key.job_id)->lost_attempts, 1);
}

TEST_F(JobManagerTest, AHeartbeatKeepsTheLeaseAndCarriesProgress) {
  const auto worker = submit_and_launch();
  JobProgress progress;
  progress.iteration = 12;
  for (int i = 0; i < 10; ++i) {
    clock.advance(10s);
    EXPECT_EQ(manager->heartbeat(worker.key, worker.token, progress), LeaseTable::Wanted::Continue);
    settle();
  }
  EXPECT_EQ(state(worker.key.job_id), JobState::Running);
  EXPECT_EQ(manager->get(worker.key.job_id).progress->iteration, 12);
}

TEST_F(JobManagerTest, ProgressEndsWithTheAttempt) {
  const auto worker = submit_and_launch();
  manager->heartbeat(worker.key, worker.token, {});
  launcher->end(worker.key, {WorkerExit::Kind::Exited, 1});
  EXPECT_FALSE(manager->get(worker.key.job_id).progress.has_value());
}

TEST_F(JobManagerTest, ACancelReachesTheWorkerByHeartbeatThenBySignals) {
  const auto worker = submit_and_launch();
  cancel(worker.key.job_id);
  EXPECT_EQ(manager->heartbeat(worker.key, worker.token, {}), LeaseTable::Wanted::Cancel);
  settle();
  EXPECT_THAT(launcher->terminated(), IsEmpty());
  clock.advance(1000ms);
  settle();
  EXPECT_THAT(launcher->terminated(), ElementsAre(worker.key));
  clock.advance(600ms);
  settle();
  EXPECT_THAT(launcher->killed(), ElementsAre(worker.key));
  launcher->end(worker.key, {WorkerExit::Kind::Signalled, 9});
  EXPECT_EQ(state(worker.key.job_id), JobState::Cancelled);
}

TEST_F(JobManagerTest, AnAttemptThatIsNotWantedGetsNoLease) {
  const auto worker = submit_and_launch();
  EXPECT_THROW(manager->acquire(worker.key, "guessed"), Refusal);
  EXPECT_THROW(manager->acquire({worker.key.job_id, 2}, worker.token), Refusal);
  cancel(worker.key.job_id);
  EXPECT_THROW(manager->acquire(worker.key, worker.token), Refusal);
}

TEST_F(JobManagerTest, AWorkerThatLingersAfterItsResultIsKilled) {
  const auto worker = submit_and_launch();
  ASSERT_TRUE(complete(worker, Delivered{}));
  clock.advance(4999ms);
  settle();
  EXPECT_THAT(launcher->killed(), IsEmpty());
  clock.advance(1ms);
  settle();
  EXPECT_THAT(launcher->killed(), ElementsAre(worker.key));
  EXPECT_EQ(state(worker.key.job_id), JobState::Succeeded);
}

TEST_F(JobManagerTest, AWorkerThatCannotBeStartedIsTriedThreeTimes) {
  launcher->refuse_starts = true;
  const auto id = submit();
  for (int i = 0; i < 10; ++i) wait_for_retry();
  const auto job = *store.table.find(id);
  EXPECT_EQ(job.state, JobState::Failed);
  EXPECT_EQ(job.attempt, 3);
  EXPECT_THAT(job.failure->message, ::testing::HasSubstr("no such program"));
}

TEST_F(JobManagerTest, ALossThatTheStoreCouldNotKeepIsTriedAgain) {
  const auto worker = submit_and_launch();
  store.refuse_writes = true;
  launcher->end(worker.key, {WorkerExit::Kind::Signalled, 11});
  EXPECT_EQ(state(worker.key.job_id), JobState::Running);
  store.refuse_writes = false;
  clock.advance(30s);
  settle();
  wait_for_retry();
  EXPECT_EQ(launcher->started().back().key.attempt, 2);
}

TEST_F(JobManagerTest, OnlyTheLatestCheckpointIsKeptAndTheNextAttemptGetsIt) {
  const auto worker = submit_and_launch();
  EXPECT_FALSE(manager->acquire(worker.key, worker.token).checkpoint.has_value());
  EXPECT_TRUE(put_checkpoint(worker, "sha256:1"));
  EXPECT_THAT(bytes.removed, IsEmpty());
  EXPECT_TRUE(put_checkpoint(worker, "sha256:2"));
  EXPECT_THAT(bytes.removed, ElementsAre("sha256:1"));
  EXPECT_TRUE(put_checkpoint(worker, "sha256:2"));
  EXPECT_THAT(bytes.removed, ElementsAre("sha256:1"));

  launcher->end(worker.key, {WorkerExit::Kind::Signalled, 11});
  wait_for_retry();
  const auto second = launcher->started().back();
  EXPECT_EQ(second.key.attempt, 2);
  EXPECT_EQ(manager->acquire(second.key, second.token).checkpoint->digest, "sha256:2");
  EXPECT_TRUE(complete(second, Delivered{}));
  EXPECT_THAT(bytes.removed, ElementsAre("sha256:1", "sha256:2"));
  EXPECT_FALSE(store.table.blob_size("sha256:2").has_value());
}

TEST_F(JobManagerTest, ACheckpointThatIsAlsoAResultStays) {
  const auto worker = submit_and_launch();
  EXPECT_TRUE(put_checkpoint(worker, "sha256:1"));
  EXPECT_TRUE(complete(worker, Delivered{{{"field", "sha256:1", 5}}}));
  EXPECT_THAT(bytes.removed, IsEmpty());
}

TEST_F(JobManagerTest, ARetryWaitsAndThenStarts) {
  const auto worker = submit_and_launch();
  launcher->end(worker.key, {WorkerExit::Kind::Signalled, 11});
  clock.advance(4999ms);
  settle();
  EXPECT_EQ(launcher->started().size(), 1u);
  clock.advance(1ms);
  settle();
  EXPECT_EQ(launcher->started().size(), 2u);
}

TEST_F(JobManagerTest, AJobThatWaitsForItsRetryHoldsNobodyUp) {
  const auto worker = submit_and_launch();
  const auto other = submit();
  launcher->end(worker.key, {WorkerExit::Kind::Signalled, 11});
  settle();
  EXPECT_THAT(started_ids(), ElementsAre(worker.key.job_id, other));
}

TEST_F(JobManagerTest, ARestartKeepsTheDelayOfARetry) {
  const auto worker = submit_and_launch();
  launcher->end(worker.key, {WorkerExit::Kind::Signalled, 11});
  make_manager();
  manager->recover();
  clock.advance(4999ms);
  settle();
  EXPECT_THAT(launcher->started(), IsEmpty());
  clock.advance(1ms);
  settle();
  EXPECT_EQ(launcher->started().size(), 1u);
}

TEST_F(JobManagerTest, AnUnresponsiveWorkerHoldsItsMemoryUntilItIsGone) {
  const auto worker = submit_and_launch();
  const auto other = submit();
  clock.advance(30s);
  settle();
  EXPECT_THAT(launcher->killed(), ElementsAre(worker.key));
  EXPECT_THAT(started_ids(), ElementsAre(worker.key.job_id));
  launcher->end(worker.key, {WorkerExit::Kind::Signalled, 9});
  settle();
  EXPECT_THAT(started_ids(), ElementsAre(worker.key.job_id, other));
}

TEST_F(JobManagerTest, AnAttemptThatStandsStillIsEndedAndTriedAgain) {
  settings.stall_timeout = 60s;
  make_manager();
  const auto worker = submit_and_launch();
  for (int i = 0; i < 12; ++i) {
    EXPECT_THAT(launcher->terminated(), IsEmpty());
    clock.advance(5s);
    manager->heartbeat(worker.key, worker.token, {});
    settle();
  }
  EXPECT_THAT(launcher->terminated(), ElementsAre(worker.key));
  EXPECT_THAT(launcher->killed(), IsEmpty());
  EXPECT_EQ(state(worker.key.job_id), JobState::Queued);
  EXPECT_EQ(store.table.find(worker.key.job_id)->last_loss->reason, "STALLED");
  EXPECT_THROW(manager->heartbeat(worker.key, worker.token, {}), Refusal);
  clock.advance(5s);
  settle();
  EXPECT_THAT(launcher->killed(), ElementsAre(worker.key));
  launcher->end(worker.key, {WorkerExit::Kind::Signalled, 9});
  settle();
  EXPECT_EQ(launcher->started().back().key.attempt, 2);
  EXPECT_EQ(store.table.find(worker.key.job_id)->crashes, 0);
}

TEST_F(JobManagerTest, AnAttemptBeyondItsWallTimeFailsForGood) {
  NewJob job;
  job.limits.wall_seconds = 10;
  const auto id = submit(job);
  settle();
  const auto worker = launcher->started().back();
  clock.advance(9999ms);
  settle();
  EXPECT_EQ(state(id), JobState::Running);
  clock.advance(1ms);
  settle();
  EXPECT_EQ(state(id), JobState::Failed);
  EXPECT_EQ(store.table.find(id)->failure->reason, "WALL_TIME");
  EXPECT_THAT(launcher->terminated(), ElementsAre(worker.key));
  clock.advance(5s);
  settle();
  EXPECT_THAT(launcher->killed(), ElementsAre(worker.key));
  launcher->end(worker.key, {WorkerExit::Kind::Signalled, 9});
  EXPECT_EQ(state(id), JobState::Failed);
}

TEST_F(JobManagerTest, TheWallTimeGoesOnOverARestart) {
  NewJob job;
  job.limits.wall_seconds = 10;
  const auto id = submit(job);
  settle();
  const auto worker = launcher->started().back();
  clock.advance(6s);
  make_manager();
  launcher->adoptable.insert(worker.key);
  manager->recover();
  clock.advance(4s);
  settle();
  EXPECT_EQ(store.table.find(id)->failure->reason, "WALL_TIME");
}

TEST_F(JobManagerTest, AWorkerBeyondItsLimitsFailsTheJob) {
  for (const bool is_memory : {false, true}) {
    NewJob job;
    job.limits = {.cpu_seconds = 100, .memory_bytes = 1000};
    const auto id = submit(job);
    settle();
    const auto worker = launcher->started().back();
    JobProgress progress;
    progress.cpu_seconds = is_memory ? 1 : 101;
    progress.memory_bytes = is_memory ? 1001 : 1;
    manager->heartbeat(worker.key, worker.token, progress);
    settle();
    EXPECT_EQ(store.table.find(id)->failure->reason, is_memory ? "MEMORY_LIMIT" : "CPU_TIME");
    launcher->end(worker.key, {WorkerExit::Kind::Exited, 5});
    settle();
  }
}

TEST_F(JobManagerTest, AWorkerThatTheKernelEndedForItsProcessorTimeIsNoCrash) {
  for (const bool has_limit : {true, false}) {
    NewJob job;
    job.limits.cpu_seconds = has_limit ? 100 : 0;
    const auto id = submit(job);
    settle();
    launcher->end(launcher->started().back().key, {WorkerExit::Kind::Signalled, 24});
    const auto found = *store.table.find(id);
    EXPECT_EQ(found.state, has_limit ? JobState::Failed : JobState::Queued);
    if (has_limit) {
      EXPECT_EQ(found.failure->reason, "CPU_TIME");
    }
    EXPECT_EQ(found.crashes, has_limit ? 0 : 1);
    settle();
  }
}

TEST_F(JobManagerTest, AWorkerWithoutMemoryFailsTheJobForGood) {
  for (const std::int64_t limit : {0ll, 1ll << 30}) {
    NewJob job;
    job.limits.memory_bytes = limit;
    const auto id = submit(job);
    settle();
    launcher->end(launcher->started().back().key, {WorkerExit::Kind::Exited, 6});
    const auto found = *store.table.find(id);
    EXPECT_EQ(found.state, JobState::Failed);
    EXPECT_EQ(found.failure->reason, "MEMORY_LIMIT");
    EXPECT_THAT(found.failure->message, ::testing::HasSubstr(limit > 0 ? "1.0 GiB" : "no memory left on its machine"));
    settle();
  }
}

TEST_F(JobManagerTest, AWorkerWithoutRoomForItsResultsIsTriedAgainAndSaysWhy) {
  const auto worker = submit_and_launch();
  launcher->end(worker.key, {WorkerExit::Kind::Exited, 7});
  EXPECT_EQ(state(worker.key.job_id), JobState::Queued);
  EXPECT_EQ(store.table.find(worker.key.job_id)->last_loss->reason, "STORAGE_FULL");
  for (int attempt = 2; attempt <= 3; ++attempt) {
    wait_for_retry();
    launcher->end(launcher->started().back().key, {WorkerExit::Kind::Exited, 7});
  }
  EXPECT_THAT(store.table.find(worker.key.job_id)->failure->message, ::testing::HasSubstr("no room for the results"));
}

TEST_F(JobManagerTest, WhatCannotBeRecordedIsNotKilled) {
  const auto worker = submit_and_launch();
  store.refuse_writes = true;
  clock.advance(30s);
  settle();
  EXPECT_THAT(launcher->killed(), IsEmpty());
  store.refuse_writes = false;
  clock.advance(30s);
  settle();
  EXPECT_THAT(launcher->killed(), ElementsAre(worker.key));
}

}  // namespace
}  // namespace saltus::server
