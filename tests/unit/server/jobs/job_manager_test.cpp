#include "tests/unit/server/jobs/job_manager_fixture.h"

#include <gmock/gmock.h>

namespace saltus::server {
namespace {

using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

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

TEST_F(JobManagerTest, AJobCancelledBeforeItsWorkerStartedStartsNone) {
  const auto id = submit();
  manager->tick();  // taken from the queue, not yet launched
  ASSERT_EQ(state(id), JobState::Running);
  cancel(id);
  settle();
  EXPECT_THAT(launcher->started(), IsEmpty());
  EXPECT_EQ(state(id), JobState::Cancelled);
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

TEST_F(JobManagerTest, ARestartGivesNobodyASecondTurn) {
  const auto ask = [&](const std::string& submitter) {
    NewJob job;
    job.submitter = submitter;
    return submit(job);
  };
  const auto ann1 = ask("ann"), ann2 = ask("ann"), ann3 = ask("ann"), bob1 = ask("bob"), bob2 = ask("bob");
  std::vector<std::string> order;
  for (int i = 0; i < 5; ++i) {
    make_manager();
    manager->recover();
    settle();
    const auto worker = launcher->started().back();
    order.push_back(worker.key.job_id);
    clock.advance(1s);
    ASSERT_TRUE(complete(worker, Delivered{}));
    launcher->end(worker.key, {WorkerExit::Kind::Exited, 0});
  }
  EXPECT_THAT(order, ::testing::ElementsAre(ann1, bob1, ann2, bob2, ann3));
}

TEST_F(JobManagerTest, AJobThatHasBeenPickedIsNextUntilItsStartIsInSafety) {
  const auto before = submit_and_launch();
  clock.advance(10s);
  complete(before, Delivered{});
  launcher->end(before.key, {WorkerExit::Kind::Exited, 0});
  const auto picked = submit();
  store.holds_writes = true;
  settle();
  const JobView view = manager->get(picked);
  EXPECT_EQ(view.job.state, JobState::Queued);
  EXPECT_EQ(view.queue_position, 1);
  EXPECT_EQ(view.estimated_start, clock.wall());
  EXPECT_EQ(store.release(), 1u);
  EXPECT_EQ(state(picked), JobState::Running);
  EXPECT_EQ(manager->get(picked).queue_position, 0);
}

TEST_F(JobManagerTest, TheStoresLastWordNeedsNoLauncher) {
  for (const bool is_batch : {false, true}) {
    make_manager();
    launcher->is_batch = is_batch;
    make_manager_of_launcher();
    manager->recover();
    const auto job = submit();
    store.holds_writes = true;
    settle();
    launcher->is_gone = true;
    EXPECT_EQ(store.release(), 1u);
    EXPECT_EQ(state(job), JobState::Running);
    EXPECT_EQ(launcher->asked_when_gone, 0) << (is_batch ? "batch system" : "processes");
    store.table = {};
  }
}

}  // namespace
}  // namespace saltus::server
