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
    ManagerSettings settings;
    settings.slots = slots;
    settings.default_threads = 4;
    manager = std::make_unique<JobManager>(
        store, blobs, *launcher, clock, ids, settings, [this] { ++wakes; }, [](const std::string&) {});
  }

  std::string submit(int threads = 0) {
    NewJob job;
    job.threads = threads;
    std::string id;
    manager->submit(job, [&](std::exception_ptr error, const JobView& view) {
      ASSERT_FALSE(error);
      id = view.job.id;
    });
    return id;
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
  for (int i = 0; i < 10; ++i) settle();
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
  settle();
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
  const auto all = manager->list(std::nullopt, 1000, 10);
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
  settle();
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

}  // namespace
}  // namespace saltus::server
