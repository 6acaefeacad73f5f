#include "server/jobs/job_manager.h"
#include "server/jobs/refusal.h"
#include "tests/support/server_fakes.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace saltus::server {
namespace {

using namespace std::chrono_literals;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::Not;

/// Remembers what was removed; the tests below need nothing else of it.
class RecordingBlobs final : public BlobStore {
 public:
  std::unique_ptr<BlobUpload> begin(const UploadPlan&) override { throw std::logic_error("not here"); }
  std::int64_t committed(const UploadPlan&) override { throw std::logic_error("not here"); }
  void publish(BlobUpload&) override { throw std::logic_error("not here"); }
  bool holds(const std::string&, std::int64_t) const override { return true; }
  std::unique_ptr<BlobReader> open(const std::string&, std::int64_t) override { throw std::logic_error("not here"); }
  void remove(const std::string& digest) override { removed.push_back(digest); }
  std::vector<std::string> named_before(WallTime) override { throw std::logic_error("not here"); }
  Leftovers expire_uploads(std::chrono::milliseconds) override { throw std::logic_error("not here"); }
  int uploads_left() override { throw std::logic_error("not here"); }
  int set_aside() override { throw std::logic_error("not here"); }
  std::vector<std::string> removed;
};

class JobManagerTest : public ::testing::Test {
 protected:
  JobManagerTest() { make_manager(); }

  /// As after a start of the daemon on the same store.
  void make_manager() {
    manager.reset();
    launcher = std::make_unique<testing_support::FakeLauncher>();
    settings.slots = slots;
    settings.default_threads = 4;
    manager = std::make_unique<JobManager>(
        store, blobs, *launcher, clock, ids, settings, [this] { ++wakes; }, [](const std::string&) {});
  }

  std::string submit(int threads = 0) {
    NewJob job;
    job.threads = threads;
    return submit(job);
  }
  std::string submit(const NewJob& job) {
    std::string id;
    manager->submit(job, [&](std::exception_ptr error, const JobView& view) {
      ASSERT_FALSE(error);
      id = view.job.id;
    });
    return id;
  }
  /// The reason of the refusal, "" when the job was accepted.
  std::string reason_for(const NewJob& job) {
    try {
      manager->submit(job, [](std::exception_ptr error, const JobView&) { ASSERT_FALSE(error); });
    } catch (const Refusal& refusal) {
      return refusal.reason();
    }
    return "";
  }
  /// The delay of every retry is over.
  void wait_for_retry() {
    clock.advance(20s);
    settle();
  }
  std::vector<std::string> started_ids() {
    std::vector<std::string> ids;
    for (const auto& request : launcher->started()) ids.push_back(request.key.job_id);
    return ids;
  }
  /// One tick decides, the next launches.
  void settle() {
    for (int i = 0; i < 4; ++i) manager->tick();
  }
  LaunchRequest submit_and_launch() {
    submit();
    settle();
    return launcher->started().back();
  }
  JobState state(const std::string& id) { return store.table.find(id)->state; }
  void cancel(const std::string& id) {
    manager->cancel(id, [](std::exception_ptr error, const JobView&) { EXPECT_FALSE(error); });
  }
  bool complete(const LaunchRequest& worker, const Outcome& outcome) {
    bool is_done = false;
    manager->complete(worker.key, worker.token, outcome,
                      [&](std::exception_ptr error, const JobRecord&) { is_done = !error; });
    return is_done;
  }

  bool put_checkpoint(const LaunchRequest& worker, const std::string& digest) {
    store.table.insert_blob(digest, 5, clock.wall());
    bool is_done = false;
    manager->put_checkpoint(worker.key, worker.token, {.digest = digest, .size = 5},
                            [&](std::exception_ptr error, const JobRecord&) { is_done = !error; });
    return is_done;
  }

  ManagerSettings settings;
  int slots = 1;
  int wakes = 0;
  testing_support::FakeClock clock;
  testing_support::FakeIds ids;
  testing_support::MemoryStore store;
  RecordingBlobs bytes;
  BlobCatalog blobs{store, bytes, clock};
  std::unique_ptr<testing_support::FakeLauncher> launcher;
  std::unique_ptr<JobManager> manager;
};

TEST_F(JobManagerTest, StartsNoMoreWorkersThanSlots) {
  slots = 2;
  make_manager();
  for (int i = 0; i < 3; ++i) submit();
  settle();
  EXPECT_EQ(launcher->started().size(), 2u);
  EXPECT_EQ(manager->running_jobs(), 2);
  EXPECT_EQ(manager->queued_jobs(), 1);
  complete(launcher->started()[0], JobFailure{"X", "x"});
  settle();
  EXPECT_EQ(launcher->started().size(), 3u);
}

TEST_F(JobManagerTest, ThreadsAreTheJobsOwnOrTheDefault) {
  submit_and_launch();
  EXPECT_EQ(launcher->started().back().threads, 4);
  complete(launcher->started().back(), Delivered{});
  submit(2);
  settle();
  EXPECT_EQ(launcher->started().back().threads, 2);
  EXPECT_EQ(manager->acquire(launcher->started().back().key, launcher->started().back().token).threads, 2);
}

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

TEST_F(JobManagerTest, AJobCancelledBeforeItsWorkerStartedStartsNone) {
  const auto id = submit();
  manager->tick();  // taken from the queue, not yet launched
  ASSERT_EQ(state(id), JobState::Running);
  cancel(id);
  settle();
  EXPECT_THAT(launcher->started(), IsEmpty());
  EXPECT_EQ(state(id), JobState::Cancelled);
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

TEST_F(JobManagerTest, WatchersAreToldOnlyWhatTheStoreHasKept) {
  const auto worker = submit_and_launch();
  const auto watcher = manager->watchers().subscribe(worker.key.job_id, [] {});
  store.refuse_writes = true;
  EXPECT_FALSE(complete(worker, Delivered{}));
  EXPECT_FALSE(watcher->next().has_value());
  store.refuse_writes = false;
  EXPECT_TRUE(complete(worker, Delivered{}));
  EXPECT_EQ(watcher->next()->job.state, JobState::Succeeded);
}

TEST_F(JobManagerTest, AfterARestartAnAdoptedWorkerGoesOn) {
  const auto worker = submit_and_launch();
  make_manager();
  launcher->adoptable.insert(worker.key);
  manager->recover();
  EXPECT_EQ(manager->heartbeat(worker.key, worker.token, {}), LeaseTable::Wanted::Continue);
  EXPECT_TRUE(complete(worker, Delivered{}));
  EXPECT_EQ(state(worker.key.job_id), JobState::Succeeded);
}

TEST_F(JobManagerTest, AfterARestartTheJobOfAVanishedWorkerIsQueuedAgain) {
  const auto worker = submit_and_launch();
  make_manager();
  manager->recover();
  EXPECT_EQ(state(worker.key.job_id), JobState::Queued);
  wait_for_retry();
  EXPECT_EQ(launcher->started().back().key.attempt, 2);
  EXPECT_THROW(manager->heartbeat(worker.key, worker.token, {}), Refusal);
}

TEST_F(JobManagerTest, AfterARestartAWorkerOfUnknownProcessHasOneLeaseToReport) {
  for (const bool reports : {true, false}) {
    const auto worker = submit_and_launch();
    auto job = *store.table.find(worker.key.job_id);
    job.process.clear();  // the daemon died between the start of the worker and the note of it
    store.table.update(job);
    make_manager();
    manager->recover();
    clock.advance(29s);
    settle();
    EXPECT_EQ(state(worker.key.job_id), JobState::Running);
    if (reports) manager->heartbeat(worker.key, worker.token, {});
    clock.advance(1s);
    settle();
    EXPECT_EQ(state(worker.key.job_id), reports ? JobState::Running : JobState::Queued);
    wait_for_retry();
    EXPECT_EQ(store.table.find(worker.key.job_id)->attempt, reports ? 1 : 2);
    if (reports) complete(worker, Delivered{});
  }
}

TEST_F(JobManagerTest, AfterARestartACancelGoesOnOrEndsWithTheVanishedWorker) {
  const auto worker = submit_and_launch();
  cancel(worker.key.job_id);
  make_manager();
  launcher->adoptable.insert(worker.key);
  manager->recover();
  EXPECT_EQ(manager->heartbeat(worker.key, worker.token, {}), LeaseTable::Wanted::Cancel);
  clock.advance(1s);
  settle();
  EXPECT_THAT(launcher->terminated(), ElementsAre(worker.key));
  make_manager();
  manager->recover();
  EXPECT_EQ(state(worker.key.job_id), JobState::Cancelled);
}

TEST_F(JobManagerTest, ADrainEndsWorkersAndCostsThemNoAttempt) {
  const auto worker = submit_and_launch();
  const auto queued = submit();
  manager->begin_drain();
  EXPECT_THAT(launcher->terminated(), ElementsAre(worker.key));
  EXPECT_FALSE(manager->is_drained());
  EXPECT_THROW(submit(), Refusal);
  EXPECT_TRUE(complete(worker, Stopped{}));
  launcher->end(worker.key, {WorkerExit::Kind::Exited, 0});
  settle();
  EXPECT_TRUE(manager->is_drained());
  EXPECT_EQ(state(worker.key.job_id), JobState::Queued);
  EXPECT_EQ(store.table.find(worker.key.job_id)->lost_attempts, 0);
  EXPECT_EQ(state(queued), JobState::Queued);
  EXPECT_EQ(launcher->started().size(), 1u);
}

TEST_F(JobManagerTest, ADrainKillsAWorkerThatDoesNotEnd) {
  const auto worker = submit_and_launch();
  manager->begin_drain();
  clock.advance(1999ms);
  settle();
  EXPECT_THAT(launcher->killed(), IsEmpty());
  clock.advance(1ms);
  settle();
  EXPECT_THAT(launcher->killed(), Contains(worker.key));
  launcher->end(worker.key, {WorkerExit::Kind::Signalled, 9});
  EXPECT_TRUE(manager->is_drained());
  EXPECT_EQ(store.table.find(worker.key.job_id)->crashes, 0);
}

TEST_F(JobManagerTest, RemovingAJobDropsTheBytesThatNobodyElseRefersTo) {
  store.table.insert_blob("sha256:own", 1, clock.wall());
  store.table.insert_blob("sha256:shared", 1, clock.wall());
  const auto first = submit_and_launch();
  complete(first, Delivered{{{"a", "sha256:own", 1}, {"b", "sha256:shared", 1}}});
  settle();
  const auto second = submit_and_launch();
  complete(second, Delivered{{{"b", "sha256:shared", 1}}});
  manager->remove(first.key.job_id, [](std::exception_ptr error, const std::string&) { EXPECT_FALSE(error); });
  EXPECT_THAT(bytes.removed, ElementsAre("sha256:own"));
  EXPECT_TRUE(store.table.blob_size("sha256:shared").has_value());
}

TEST_F(JobManagerTest, TellsTheirPlaceToQueuedJobs) {
  submit_and_launch();
  const auto second = submit();
  const auto third = submit();
  EXPECT_EQ(manager->get(second).queue_position, 1);
  EXPECT_EQ(manager->get(third).queue_position, 2);
  const auto all = manager->list({}, 1000, 10);
  ASSERT_EQ(all.size(), 3u);
  EXPECT_EQ(all[0].queue_position, 2);
  EXPECT_EQ(all[1].queue_position, 1);
  EXPECT_EQ(all[2].queue_position, 0);
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

TEST_F(JobManagerTest, AQueuedJobThatIsCancelledOrDeletedTakesItsCheckpointAlong) {
  for (const bool deletes : {false, true}) {
    const auto worker = submit_and_launch();
    const std::string digest = deletes ? "sha256:deleted" : "sha256:cancelled";
    EXPECT_TRUE(put_checkpoint(worker, digest));
    manager->begin_drain();
    launcher->end(worker.key, {WorkerExit::Kind::Exited, 5});
    EXPECT_EQ(state(worker.key.job_id), JobState::Queued);
    if (deletes)
      manager->remove(worker.key.job_id, [](std::exception_ptr error, const std::string&) { EXPECT_FALSE(error); });
    else
      cancel(worker.key.job_id);
    EXPECT_THAT(bytes.removed, Contains(digest));
    make_manager();
  }
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

TEST_F(JobManagerTest, HigherPrioritiesStartFirst) {
  const auto running = submit_and_launch();
  std::vector<std::string> ids;
  for (const int priority : {kLowestPriority, kDefaultPriority, kHighestPriority}) {
    NewJob job;
    job.priority = priority;
    ids.push_back(submit(job));
  }
  EXPECT_EQ(manager->get(ids[2]).queue_position, 1);
  for (int i = 0; i < 3; ++i) {
    complete(launcher->started().back(), Delivered{});
    settle();
  }
  EXPECT_THAT(started_ids(), ElementsAre(running.key.job_id, ids[2], ids[1], ids[0]));
}

TEST_F(JobManagerTest, AJobThatDoesNotFitIntoTheMemoryWaits) {
  slots = 4;
  settings.memory_budget = 1000;
  settings.default_memory = 100;
  make_manager();
  NewJob large;
  large.memory_bytes = 600;
  const auto first = submit(large);
  const auto second = submit(large);
  const auto small = submit();
  settle();
  EXPECT_THAT(started_ids(), ElementsAre(first, small));
  complete(launcher->started()[0], Delivered{});
  settle();
  EXPECT_THAT(started_ids(), ElementsAre(first, small, second));
}

TEST_F(JobManagerTest, AJobThatDoesNotFitIntoTheThreadsWaits) {
  slots = 4;
  settings.thread_budget = 5;
  make_manager();
  const auto first = submit(3);
  const auto second = submit(3);
  const auto third = submit(2);
  settle();
  EXPECT_THAT(started_ids(), ElementsAre(first, third));
  complete(launcher->started()[0], Delivered{});
  settle();
  EXPECT_THAT(started_ids(), ElementsAre(first, third, second));
}

TEST_F(JobManagerTest, AJobLargerThanTheWholeBudgetIsRefused) {
  settings.memory_budget = 1000;
  settings.thread_budget = 4;
  make_manager();
  NewJob job;
  job.memory_bytes = 1001;
  EXPECT_EQ(reason_for(job), "EXCEEDS_BUDGET");
  job.memory_bytes = 1000;
  job.threads = 5;
  EXPECT_EQ(reason_for(job), "EXCEEDS_BUDGET");
  job.threads = 4;
  EXPECT_EQ(reason_for(job), "");
}

TEST_F(JobManagerTest, AJobThatASmallerBudgetWouldRefuseNowRunsAlone) {
  NewJob job;
  job.memory_bytes = 1 << 20;
  const auto id = submit(job);
  const auto other = submit();
  slots = 2;
  settings.memory_budget = 1000;
  make_manager();
  manager->recover();
  settle();
  EXPECT_THAT(started_ids(), ElementsAre(id));
  complete(launcher->started()[0], Delivered{});
  settle();
  EXPECT_THAT(started_ids(), ElementsAre(id, other));
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

TEST_F(JobManagerTest, ABatchIsAcceptedWholeOrNotAtAll) {
  settings.queue.max_queued = 3;
  make_manager();
  std::vector<JobView> views;
  std::string reason;
  const auto submit_all = [&](int count) {
    manager->submit_all(std::vector<NewJob>(count), [&](std::exception_ptr error, const std::vector<JobView>& made) {
      views = made;
      reason.clear();
      try {
        if (error) std::rethrow_exception(error);
      } catch (const Refusal& refusal) {
        reason = refusal.reason();
      }
    });
  };
  submit_all(4);
  EXPECT_EQ(reason, "QUEUE_FULL");
  EXPECT_EQ(manager->queued_jobs(), 0);
  EXPECT_EQ(store.table.count(JobState::Queued), 0);
  submit_all(3);
  EXPECT_EQ(reason, "");
  ASSERT_EQ(views.size(), 3u);
  for (int i = 0; i < 3; ++i) EXPECT_EQ(views[i].queue_position, i + 1);
}

TEST_F(JobManagerTest, EstimatesTheStartFromTheJobsBefore) {
  const auto first = submit_and_launch();
  const auto second = submit();
  EXPECT_FALSE(manager->get(second).estimated_start.has_value());
  clock.advance(10s);
  complete(first, Delivered{});
  settle();
  const auto third = submit();
  const auto fourth = submit();
  clock.advance(4s);
  EXPECT_EQ(manager->get(third).estimated_start, clock.wall() + 6s);
  EXPECT_EQ(manager->get(fourth).estimated_start, clock.wall() + 16s);
  EXPECT_FALSE(manager->get(second).estimated_start.has_value());
  make_manager();
  manager->recover();
  EXPECT_TRUE(manager->get(fourth).estimated_start.has_value());
}

TEST_F(JobManagerTest, ADeletedJobIsNotWaitedFor) {
  submit_and_launch();
  const auto second = submit();
  const auto third = submit();
  manager->remove(second, [](std::exception_ptr error, const std::string&) { EXPECT_FALSE(error); });
  EXPECT_EQ(manager->queued_jobs(), 1);
  EXPECT_EQ(manager->get(third).queue_position, 1);
}

}  // namespace
}  // namespace saltus::server
