// Attempts of workers that come by themselves and ask for jobs.
#include "tests/unit/server/jobs/job_manager_fixture.h"

#include <gmock/gmock.h>

namespace saltus::server {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

class TakenAttempts : public JobManagerTest {
 protected:
  struct Answer {
    bool is_there = false;
    std::optional<TakenJob> job;
  };

  TakenAttempts() {
    slots = 0;
    make_manager();
  }
  /// The place of the answer in `answers`.
  std::size_t ask(const Offer& offer = {8, 0}, std::chrono::milliseconds wait = 20s) {
    answers.emplace_back();
    const std::size_t place = answers.size() - 1;
    takers.push_back(manager->take(offer, wait, [this, place](const std::optional<TakenJob>& job) {
      ASSERT_FALSE(answers[place].is_there);
      answers[place] = {true, job};
    }));
    return place;
  }
  TakenJob take() {
    const std::size_t place = ask();
    settle();
    return answers[place].job.value_or(TakenJob{});
  }
  std::string id_of(std::size_t place) { return answers[place].job ? answers[place].job->key.job_id : ""; }
  JobRecord row(const TakenJob& job) { return *store.table.find(job.key.job_id); }

  std::vector<Answer> answers;
  std::vector<std::uint64_t> takers;
};

TEST_F(TakenAttempts, AJobGoesToWhoAsksAndTheAnswerIsItsLease) {
  const std::string id = submit();
  settle();
  EXPECT_EQ(state(id), JobState::Queued);
  const TakenJob job = take();
  EXPECT_EQ(job.key, (AttemptKey{id, 1}));
  EXPECT_EQ(job.threads, 4);
  EXPECT_EQ(state(id), JobState::Running);
  EXPECT_THAT(launcher->started(), IsEmpty());
  EXPECT_EQ(manager->acquire(job.key, job.token).threads, 4);
  EXPECT_TRUE(complete({job.key, job.token}, Delivered{}));
  EXPECT_EQ(state(id), JobState::Succeeded);
}

TEST_F(TakenAttempts, WhoHasWaitedLongestIsFirst) {
  const auto first = ask(), second = ask(), third = ask();
  const std::string a = submit(), b = submit();
  settle();
  EXPECT_EQ(id_of(first), a);
  EXPECT_EQ(id_of(second), b);
  EXPECT_FALSE(answers[third].is_there);
}

TEST_F(TakenAttempts, NobodyGetsMoreThanHeOffers) {
  NewJob large;
  large.threads = 16;
  large.memory_bytes = 100;
  const std::string id = submit(large);
  const auto few_threads = ask({8, 1000}), little_memory = ask({16, 99}), enough = ask({16, 100});
  settle();
  EXPECT_FALSE(answers[few_threads].is_there);
  EXPECT_FALSE(answers[little_memory].is_there);
  EXPECT_EQ(id_of(enough), id);
  // What fits nobody who is there holds nobody up.
  submit(large);
  for (int i = 0; i < 20; ++i) EXPECT_EQ((submit(1), settle(), ask({8, 1000}), settle(), 0), 0);
  EXPECT_EQ(store.table.count(JobState::Queued), 1);
}

TEST_F(TakenAttempts, AnAskerIsSentAwayWhenItsTimeIsOver) {
  const auto place = ask({8, 0}, 20s);
  settle();
  EXPECT_FALSE(answers[place].is_there);
  clock.advance(20s);
  settle();
  EXPECT_TRUE(answers[place].is_there);
  EXPECT_FALSE(answers[place].job);
  submit();
  settle();
  EXPECT_EQ(store.table.count(JobState::Queued), 1);
}

TEST_F(TakenAttempts, AStopSendsAllAway) {
  const auto place = ask();
  manager->begin_drain();
  settle();
  EXPECT_TRUE(answers[place].is_there);
  EXPECT_FALSE(answers[place].job);
}

TEST_F(TakenAttempts, WhileTheDaemonIsPausedTheyWait) {
  const auto place = ask();
  submit();
  manager->set_paused(true);
  settle();
  EXPECT_FALSE(answers[place].is_there);
  manager->set_paused(false);
  settle();
  EXPECT_TRUE(answers[place].job);
}

TEST_F(TakenAttempts, OneThatHasGoneGetsNothing) {
  const auto gone = ask(), there = ask();
  manager->withdraw(takers[gone]);
  EXPECT_TRUE(answers[gone].is_there);
  const std::string id = submit();
  settle();
  EXPECT_EQ(id_of(there), id);
}

TEST_F(TakenAttempts, AJobWhoseTakerIsNotHeardOfAgainCostsNoAttempt) {
  const std::string id = submit();
  for (int round = 1; round <= 5; ++round) {
    const TakenJob job = take();
    EXPECT_EQ(job.key, (AttemptKey{id, round}));
    clock.advance(settings.lease);
    settle();
    EXPECT_EQ(row(job).state, JobState::Queued);
    EXPECT_EQ(row(job).lost_attempts, 0);
    EXPECT_EQ(row(job).last_loss->reason, "NEVER_BEGUN");
    EXPECT_THROW(manager->acquire(job.key, job.token), Refusal);
    wait_for_retry();
  }
}

TEST_F(TakenAttempts, AfterItsFirstCallALeaseThatEndsIsALoss) {
  submit();
  const TakenJob job = take();
  manager->acquire(job.key, job.token);
  clock.advance(settings.lease);
  settle();
  EXPECT_EQ(row(job).last_loss->reason, "LEASE_EXPIRED");
  EXPECT_EQ(row(job).lost_attempts, 1);
}

TEST_F(TakenAttempts, AnEndThatIsReportedIsKnownAtOnceAndOnlyFromItsHolder) {
  submit();
  const TakenJob job = take();
  manager->acquire(job.key, job.token);
  manager->report_exit(job.key, "another token", {WorkerExit::Kind::Signalled, 9});
  EXPECT_EQ(row(job).state, JobState::Running);
  manager->report_exit(job.key, job.token, {WorkerExit::Kind::Signalled, 9});
  EXPECT_EQ(row(job).last_loss->reason, "WORKER_CRASHED");
  EXPECT_EQ(row(job).crashes, 1);
  manager->report_exit(job.key, job.token, {WorkerExit::Kind::Signalled, 9});
  EXPECT_EQ(row(job).crashes, 1);
}

TEST_F(TakenAttempts, TheEndAfterAnOutcomeIsNoLoss) {
  submit();
  const TakenJob job = take();
  manager->acquire(job.key, job.token);
  complete({job.key, job.token}, Delivered{});
  manager->report_exit(job.key, job.token, {WorkerExit::Kind::Exited, 0});
  EXPECT_EQ(row(job).state, JobState::Succeeded);
  EXPECT_FALSE(row(job).last_loss);
}

TEST_F(TakenAttempts, AStopOfTheDaemonLeavesThemAndTheNextHearsOfThem) {
  submit();
  const TakenJob job = take();
  manager->acquire(job.key, job.token);
  manager->begin_drain();
  settle();
  EXPECT_TRUE(manager->is_drained());
  make_manager();
  manager->recover();
  clock.advance(20s);
  EXPECT_EQ(manager->heartbeat(job.key, job.token, {}), LeaseTable::Wanted::Continue);
  EXPECT_EQ(row(job).attempt, 1);
  EXPECT_TRUE(complete({job.key, job.token}, Delivered{}));
}

TEST_F(TakenAttempts, TheLauncherHasItsPartWhenThereIsOne) {
  slots = 1;
  make_manager();
  const std::string a = submit(), b = submit();
  const auto place = ask();
  settle();
  EXPECT_THAT(started_ids(), ElementsAre(a));
  EXPECT_EQ(id_of(place), b);
}

TEST_F(TakenAttempts, AStoreThatCannotWriteKeepsJobsAndAskers) {
  const std::string id = submit();
  const auto place = ask();
  store.refuse_writes = true;
  settle();
  EXPECT_FALSE(answers[place].is_there);
  EXPECT_EQ(manager->queued_jobs(), 1);
  store.refuse_writes = false;
  settle();
  EXPECT_EQ(id_of(place), id);
}

TEST_F(TakenAttempts, ManyStartInOneTransactionAndInOrder) {
  std::vector<std::string> submitted;
  for (int i = 0; i < 200; ++i) submitted.push_back(submit());
  for (int i = 0; i < 200; ++i) ask();
  for (int i = 0; i < 4; ++i) manager->tick();
  std::vector<std::string> got;
  for (std::size_t i = 0; i < answers.size(); ++i) got.push_back(id_of(i));
  EXPECT_EQ(got, submitted);
}

}  // namespace
}  // namespace saltus::server
