#include "server/jobs/job_queue.h"
#include "server/jobs/input_refusal.h"
#include "server/jobs/refusal.h"
#include "tests/support/server_fakes.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace saltus::server {
namespace {

using namespace std::chrono_literals;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

const std::string kInput = "sha256:input";

class JobQueueTest : public ::testing::Test {
 protected:
  JobQueueTest() { table.insert_blob(kInput, 10, clock.wall()); }

  NewJob asked(const std::string& request_id = "", const std::string& hash = "h") const {
    NewJob job;
    job.request_id = request_id;
    job.request_hash = hash;
    job.spec = "spec";
    job.inputs = {kInput};
    return job;
  }
  JobQueue::Taken submit_and_take() {
    queue.submit(table, asked());
    return take();
  }
  /// Starts the oldest queued job.
  JobQueue::Taken take() { return *queue.start(table, table.queued().at(0).id); }
  bool is_queue_empty() { return table.queued().empty(); }
  static AttemptKey key(const JobQueue::Taken& taken) { return {taken.job.id, taken.job.attempt}; }

  template <class Call>
  void expect_refused(Call call, RefusalKind kind, const std::string& reason) {
    try {
      call();
      FAIL() << "was granted";
    } catch (const Refusal& refusal) {
      EXPECT_EQ(refusal.kind(), kind);
      EXPECT_EQ(refusal.reason(), reason);
    }
  }

  testing_support::FakeClock clock;
  testing_support::FakeIds ids;
  testing_support::MemoryTable table;
  JobQueue queue{clock, ids, {.max_queued = 3, .max_attempts = 3, .max_crashes = 2}};
};

TEST_F(JobQueueTest, TakesJobsInTheOrderOfTheirCreation) {
  for (int i = 0; i < 3; ++i) queue.submit(table, asked());
  EXPECT_EQ(take().job.id, "job-1");
  EXPECT_EQ(take().job.id, "job-2");
  EXPECT_EQ(take().job.id, "job-3");
  EXPECT_TRUE(is_queue_empty());
}

TEST_F(JobQueueTest, ALostJobGoesBackToItsPlaceInTheOrder) {
  queue.submit(table, asked());
  queue.submit(table, asked());
  const auto first = take();
  queue.lose(table, key(first), LossCause::LeaseExpired, "");
  const auto again = take();
  EXPECT_EQ(again.job.id, "job-1");
  EXPECT_EQ(again.job.attempt, 2);
  EXPECT_NE(again.token, first.token);
}

TEST_F(JobQueueTest, StoresTheFingerprintOfATokenAndNotTheToken) {
  const auto taken = submit_and_take();
  EXPECT_EQ(table.find(taken.job.id)->token_hash, "#" + taken.token);
}

TEST_F(JobQueueTest, TheSameRequestIdWithTheSameContentIsTheSameJob) {
  const auto first = queue.submit(table, asked("r", "a"));
  EXPECT_EQ(queue.submit(table, asked("r", "a")).id, first.id);
  EXPECT_EQ(table.count(JobState::Queued), 1);
  expect_refused([&] { queue.submit(table, asked("r", "b")); }, RefusalKind::AlreadyExists, "REQUEST_ID_REUSED");
}

TEST_F(JobQueueTest, ARepeatedRequestIsAnsweredEvenWhenTheQueueIsFull) {
  const auto first = queue.submit(table, asked("r", "a"));
  for (int i = 0; i < 2; ++i) queue.submit(table, asked());
  expect_refused([&] { queue.submit(table, asked()); }, RefusalKind::Exhausted, "QUEUE_FULL");
  EXPECT_EQ(queue.submit(table, asked("r", "a")).id, first.id);
}

TEST_F(JobQueueTest, RefusesAnInputThatIsNotThere) {
  NewJob job = asked();
  job.inputs.push_back("sha256:other");
  expect_refused([&] { queue.submit(table, job); }, RefusalKind::FailedPrecondition, "INPUT_MISSING");
}

TEST_F(JobQueueTest, CancellingAQueuedJobEndsItAtOnce) {
  const auto job = queue.submit(table, asked());
  EXPECT_EQ(queue.cancel(table, job.id).state, JobState::Cancelled);
  EXPECT_TRUE(table.find(job.id)->ended.has_value());
  EXPECT_TRUE(is_queue_empty());
}

TEST_F(JobQueueTest, CancellingIsIdempotentAndATerminalJobIsReturnedUnchanged) {
  const auto taken = submit_and_take();
  EXPECT_EQ(queue.cancel(table, taken.job.id).state, JobState::Cancelling);
  const auto revision = table.find(taken.job.id)->revision;
  EXPECT_EQ(queue.cancel(table, taken.job.id).state, JobState::Cancelling);
  EXPECT_EQ(table.find(taken.job.id)->revision, revision);
  queue.complete(table, key(taken), taken.token, Delivered{});
  EXPECT_EQ(queue.cancel(table, taken.job.id).state, JobState::Succeeded);
  expect_refused([&] { queue.cancel(table, "nobody"); }, RefusalKind::NotFound, "JOB_NOT_FOUND");
}

TEST_F(JobQueueTest, CompletesWithArtefactsThatAreThere) {
  const auto taken = submit_and_take();
  const Delivered delivered{{{"displacement.nii.gz", "sha256:out", 5}}};
  expect_refused([&] { queue.complete(table, key(taken), taken.token, delivered); }, RefusalKind::FailedPrecondition,
                 "ARTIFACT_MISSING");
  table.insert_blob("sha256:out", 6, clock.wall());
  expect_refused([&] { queue.complete(table, key(taken), taken.token, delivered); }, RefusalKind::FailedPrecondition,
                 "ARTIFACT_MISSING");
  table.erase_blob_if_unreferenced("sha256:out");
  table.insert_blob("sha256:out", 5, clock.wall());
  const auto job = queue.complete(table, key(taken), taken.token, delivered);
  EXPECT_EQ(job.state, JobState::Succeeded);
  EXPECT_THAT(job.artifacts, ElementsAre(delivered.artifacts[0]));
}

TEST_F(JobQueueTest, CompletingTwiceTheSameWayIsOneCompletion) {
  const auto taken = submit_and_take();
  const JobFailure failure{"DIVERGED", "it diverged"};
  queue.complete(table, key(taken), taken.token, failure);
  const auto revision = table.find(taken.job.id)->revision;
  EXPECT_EQ(queue.complete(table, key(taken), taken.token, failure).state, JobState::Failed);
  EXPECT_EQ(table.find(taken.job.id)->revision, revision);
  expect_refused([&] { queue.complete(table, key(taken), taken.token, Delivered{}); }, RefusalKind::Aborted,
                 "LEASE_LOST");
}

TEST_F(JobQueueTest, ADeterministicFailureIsNotRetried) {
  const auto taken = submit_and_take();
  const auto job = queue.complete(table, key(taken), taken.token, JobFailure{"GEOMETRY_MISMATCH", "no overlap"});
  EXPECT_EQ(job.state, JobState::Failed);
  EXPECT_EQ(job.failure->reason, "GEOMETRY_MISMATCH");
  EXPECT_TRUE(is_queue_empty());
}

TEST_F(JobQueueTest, AZombieCannotComplete) {
  const auto zombie = submit_and_take();
  queue.lose(table, key(zombie), LossCause::LeaseExpired, "");
  expect_refused([&] { queue.complete(table, key(zombie), zombie.token, Delivered{}); }, RefusalKind::Aborted,
                 "LEASE_LOST");
  const auto current = take();
  expect_refused([&] { queue.complete(table, key(zombie), zombie.token, Delivered{}); }, RefusalKind::Aborted,
                 "LEASE_LOST");
  expect_refused([&] { queue.complete(table, key(current), zombie.token, Delivered{}); }, RefusalKind::Aborted,
                 "LEASE_LOST");
  EXPECT_EQ(queue.complete(table, key(current), current.token, Delivered{}).state, JobState::Succeeded);
}

TEST_F(JobQueueTest, TheThirdLostAttemptIsTheLast) {
  queue.submit(table, asked());
  for (int attempt = 1; attempt <= 2; ++attempt)
    EXPECT_EQ(queue.lose(table, key(take()), LossCause::LeaseExpired, "")->state, JobState::Queued);
  const auto job = queue.lose(table, key(take()), LossCause::Exited, "exit code 3");
  EXPECT_EQ(job->state, JobState::Failed);
  EXPECT_EQ(job->failure->reason, "ATTEMPTS_EXHAUSTED");
  EXPECT_THAT(job->failure->message, HasSubstr("exit code 3"));
}

TEST_F(JobQueueTest, TheLastWordOnALostAttemptNamesWhereTheOthersWere) {
  queue.submit(table, asked());
  const auto lose = [&](const char* batch_id, const char* host, LossCause cause) {
    const AttemptKey lost = key(take());
    queue.name(table, lost, batch_id, "");
    queue.name(table, lost, batch_id, host);
    EXPECT_FALSE(queue.name(table, lost, batch_id, host));
    EXPECT_FALSE(queue.name(table, lost, batch_id, ""));
    clock.advance(std::chrono::seconds(1));
    return *queue.lose(table, lost, cause, "");
  };
  EXPECT_EQ(lose("17", "node1", LossCause::NodeFailed).last_loss->message,
            "the worker's machine failed (batch job 17 on node1)");
  EXPECT_EQ(lose("18", "", LossCause::Preempted).last_loss->message,
            "the batch system ended the worker for the sake of others (batch job 18)");
  EXPECT_EQ(take().job.batch_host, "");
  queue.lose(table, {"job-1", 3}, LossCause::Released, "");
  lose("19", "node2", LossCause::LeaseExpired);
  const JobRecord job = lose("20", "node3", LossCause::NodeFailed);
  EXPECT_EQ(
      job.failure->message,
      "attempt 3 of 3 was lost as well: the worker's machine failed (batch job 20 on node3); before it: NODE_FAILED "
      "(batch job 17 on node1), PREEMPTED (batch job 18), LEASE_EXPIRED (batch job 19 on node2); the batch system "
      "tells more of them");
  ASSERT_EQ(job.losses.size(), 5u);
  EXPECT_EQ(job.losses.front(), (LostAttempt{1, "NODE_FAILED", "17", "node1", clock.wall() - std::chrono::seconds(3)}));
  EXPECT_EQ(job.losses.back().attempt, 5);
}

TEST_F(JobQueueTest, OfManyLostAttemptsTheNewestAreKept) {
  queue.submit(table, asked());
  for (int i = 0; i < 40; ++i) queue.lose(table, key(take()), LossCause::Preempted, "");
  const auto losses = table.find("job-1")->losses;
  ASSERT_EQ(losses.size(), kMostLostAttempts);
  EXPECT_EQ(losses.front().attempt, 25);
  EXPECT_EQ(losses.back().attempt, 40);
}

TEST_F(JobQueueTest, TheSecondDeathBySignalIsPoison) {
  queue.submit(table, asked());
  EXPECT_EQ(queue.lose(table, key(take()), LossCause::Crashed, "signal 11")->state, JobState::Queued);
  const auto job = queue.lose(table, key(take()), LossCause::Crashed, "signal 11");
  EXPECT_EQ(job->state, JobState::Failed);
  EXPECT_EQ(job->failure->reason, "WORKER_CRASHED");
  EXPECT_THAT(job->failure->message, HasSubstr("signal 11"));
}

TEST_F(JobQueueTest, AShutdownOfTheDaemonCostsNoAttempt) {
  queue.submit(table, asked());
  for (int i = 0; i < 5; ++i)
    EXPECT_EQ(queue.lose(table, key(take()), LossCause::Released, "")->state, JobState::Queued);
  EXPECT_EQ(table.find("job-1")->lost_attempts, 0);
  EXPECT_EQ(take().job.attempt, 6);
}

TEST_F(JobQueueTest, ACancellingJobWhoseWorkerDiesIsCancelled) {
  for (const LossCause cause : {LossCause::Crashed, LossCause::LeaseExpired, LossCause::Released}) {
    const auto taken = submit_and_take();
    queue.cancel(table, taken.job.id);
    const auto job = queue.lose(table, key(taken), cause, "");
    EXPECT_EQ(job->state, JobState::Cancelled);
    EXPECT_FALSE(job->failure.has_value());
  }
}

TEST_F(JobQueueTest, AWorkerThatStoppedUnaskedHasLostItsAttempt) {
  const auto taken = submit_and_take();
  const auto job = queue.complete(table, key(taken), taken.token, Stopped{});
  EXPECT_EQ(job.state, JobState::Queued);
  EXPECT_EQ(job.lost_attempts, 1);
}

TEST_F(JobQueueTest, ALossIsReportedOnce) {
  const auto taken = submit_and_take();
  EXPECT_TRUE(queue.lose(table, key(taken), LossCause::Crashed, "").has_value());
  EXPECT_FALSE(queue.lose(table, key(taken), LossCause::Crashed, "").has_value());
  const auto next = take();
  queue.complete(table, key(next), next.token, Delivered{});
  EXPECT_FALSE(queue.lose(table, key(next), LossCause::Exited, "exit code 0").has_value());
}

TEST_F(JobQueueTest, ARunningJobCannotBeRemoved) {
  const auto taken = submit_and_take();
  expect_refused([&] { queue.remove(table, taken.job.id); }, RefusalKind::FailedPrecondition, "JOB_RUNNING");
  queue.cancel(table, taken.job.id);
  expect_refused([&] { queue.remove(table, taken.job.id); }, RefusalKind::FailedPrecondition, "JOB_RUNNING");
}

TEST_F(JobQueueTest, RemovingAJobTellsWhichArtefactsItHadEachOnce) {
  const auto taken = submit_and_take();
  table.insert_blob("sha256:a", 1, clock.wall());
  queue.complete(table, key(taken), taken.token, Delivered{{{"x", "sha256:a", 1}, {"y", "sha256:a", 1}}});
  EXPECT_THAT(queue.remove(table, taken.job.id), ElementsAre("sha256:a"));
  EXPECT_FALSE(table.find(taken.job.id).has_value());
}

TEST_F(JobQueueTest, ARequestIdOfAnotherSubmitterIsAnotherJob) {
  NewJob job = asked("request");
  const auto first = queue.submit(table, job);
  job.submitter = "ann";
  EXPECT_NE(queue.submit(table, job).id, first.id);
  EXPECT_EQ(table.find("job-2")->submitter, "ann");
}

TEST_F(JobQueueTest, ACheckpointIsHandedToTheNextAttempt) {
  const auto first = submit_and_take();
  table.insert_blob("sha256:check", 7, clock.wall());
  queue.put_checkpoint(table, key(first), first.token,
                       {.digest = "sha256:check", .size = 7, .level = 1, .iteration = 9});
  queue.lose(table, key(first), LossCause::Crashed, "signal 9");
  EXPECT_EQ(take().job.checkpoint,
            (Checkpoint{.digest = "sha256:check", .size = 7, .attempt = 1, .level = 1, .iteration = 9}));
}

TEST_F(JobQueueTest, ACheckpointIsFencedAndItsBlobMustBeThere) {
  const auto first = submit_and_take();
  const Checkpoint checkpoint{.digest = "sha256:check", .size = 7};
  const auto put = [&](const AttemptKey& of, const std::string& token) {
    return [this, of, token, checkpoint] { queue.put_checkpoint(table, of, token, checkpoint); };
  };
  expect_refused(put(key(first), first.token), RefusalKind::FailedPrecondition, "CHECKPOINT_MISSING");
  table.insert_blob("sha256:check", 8, clock.wall());
  expect_refused(put(key(first), first.token), RefusalKind::FailedPrecondition, "CHECKPOINT_MISSING");
  expect_refused(put(key(first), "another token"), RefusalKind::Aborted, "LEASE_LOST");
  expect_refused(put({first.job.id, 2}, first.token), RefusalKind::Aborted, "LEASE_LOST");
  queue.lose(table, key(first), LossCause::LeaseExpired, "");
  expect_refused(put(key(first), first.token), RefusalKind::Aborted, "LEASE_LOST");
  EXPECT_FALSE(table.find(first.job.id)->checkpoint.has_value());
}

TEST_F(JobQueueTest, ATerminalJobHasNoCheckpoint) {
  const auto first = submit_and_take();
  table.insert_blob("sha256:check", 7, clock.wall());
  queue.put_checkpoint(table, key(first), first.token, {.digest = "sha256:check", .size = 7});
  queue.complete(table, key(first), first.token, Delivered{});
  EXPECT_FALSE(table.find(first.job.id)->checkpoint.has_value());
}

TEST_F(JobQueueTest, StartsOnlyWhatIsQueued) {
  const auto taken = submit_and_take();
  EXPECT_FALSE(queue.start(table, taken.job.id).has_value());
  EXPECT_FALSE(queue.start(table, "nobody").has_value());
  EXPECT_EQ(table.find(taken.job.id)->attempt, 1);
}

TEST_F(JobQueueTest, EachRetryWaitsFourTimesAsLongAsTheOneBefore) {
  JobQueue patient(clock, ids, {.max_attempts = 4, .retry_delay = 5s});
  patient.submit(table, asked());
  for (const auto delay : {5s, 20s, 80s}) {
    clock.advance(1s);
    const auto lost = patient.lose(table, key(take()), LossCause::LeaseExpired, "");
    EXPECT_EQ(lost->not_before, clock.wall() + delay);
  }
  const auto last = take();
  EXPECT_FALSE(last.job.not_before.has_value());
  EXPECT_EQ(patient.lose(table, key(last), LossCause::LeaseExpired, "")->state, JobState::Failed);
}

TEST_F(JobQueueTest, AShutdownDelaysNoRetry) {
  const auto taken = submit_and_take();
  const auto job = queue.lose(table, key(taken), LossCause::Released, "");
  EXPECT_FALSE(job->not_before.has_value());
  EXPECT_FALSE(job->last_loss.has_value());
}

TEST_F(JobQueueTest, TellsWhyTheLastAttemptWasLost) {
  const auto taken = submit_and_take();
  const auto job = *queue.lose(table, key(taken), LossCause::Stalled, "900 s");
  EXPECT_EQ(job.last_loss->reason, "STALLED");
  EXPECT_THAT(job.last_loss->message, HasSubstr("900 s"));
  EXPECT_EQ(queue.complete(table, key(take()), "token-2", Delivered{}).last_loss->reason, "STALLED");
}

TEST_F(JobQueueTest, ADelayEndsWithACancel) {
  const auto taken = submit_and_take();
  queue.lose(table, key(taken), LossCause::LeaseExpired, "");
  EXPECT_FALSE(queue.cancel(table, taken.job.id).not_before.has_value());
}

TEST_F(JobQueueTest, AnExceededLimitIsFinalAndReportedOnce) {
  const auto taken = submit_and_take();
  const JobFailure failure{"WALL_TIME", "too long"};
  EXPECT_EQ(queue.fail(table, key(taken), failure)->failure, failure);
  EXPECT_FALSE(queue.fail(table, key(taken), failure).has_value());
  EXPECT_TRUE(is_queue_empty());
  expect_refused([&] { queue.complete(table, key(taken), taken.token, Delivered{}); }, RefusalKind::Aborted,
                 "LEASE_LOST");
}

TEST_F(JobQueueTest, AJobThatIsBeingCancelledIsCancelledByItsLimit) {
  const auto taken = submit_and_take();
  queue.cancel(table, taken.job.id);
  const auto job = queue.fail(table, key(taken), {"WALL_TIME", "too long"});
  EXPECT_EQ(job->state, JobState::Cancelled);
  EXPECT_FALSE(job->failure.has_value());
}

TEST_F(JobQueueTest, OneSubmitterCannotFillTheQueue) {
  JobQueue shared(clock, ids, {.max_queued = 10, .max_queued_of_submitter = 2});
  NewJob job = asked();
  for (int i = 0; i < 2; ++i) shared.submit(table, job);
  expect_refused([&] { shared.submit(table, job); }, RefusalKind::Exhausted, "QUOTA");
  job.submitter = "ann";
  shared.submit(table, job);
  job.submitter = kLocalSubmitter;
  take();
  shared.submit(table, job);
}

TEST_F(JobQueueTest, WhoHasNoQuotaHasTheWholeQueue) {
  JobQueue shared(clock, ids, {.max_queued = 3, .max_queued_of_submitter = 1});
  NewJob job = asked();
  job.has_quota = false;
  for (int i = 0; i < 3; ++i) shared.submit(table, job);
  expect_refused([&] { shared.submit(table, job); }, RefusalKind::Exhausted, "QUEUE_FULL");
}

TEST_F(JobQueueTest, WithoutRoomNothingNewIsKeptButWhatIsKnownIsTold) {
  NewJob job = asked();
  job.request_id = "request";
  const auto known = queue.submit(table, job);
  const auto no_room = [] { throw Refusal(RefusalKind::Exhausted, "STORAGE_FULL", "full"); };
  EXPECT_EQ(queue.submit(table, job, no_room).id, known.id);
  job.request_id = "another";
  expect_refused([&] { queue.submit(table, job, no_room); }, RefusalKind::Exhausted, "STORAGE_FULL");
  EXPECT_EQ(table.count(JobState::Queued), 1);
}

TEST_F(JobQueueTest, AFullQueueSaysWhenToComeBack) {
  for (int i = 0; i < 3; ++i) queue.submit(table, asked());
  try {
    queue.submit(table, asked());
    FAIL() << "was accepted";
  } catch (const Refusal& refusal) {
    EXPECT_EQ(refusal.reason(), "QUEUE_FULL");
    EXPECT_TRUE(refusal.retry_after().has_value());
  }
}

TEST_F(JobQueueTest, TellsAllInputsThatAreMissingEachOnce) {
  NewJob job = asked();
  job.inputs = {"sha256:b", kInput, "sha256:a", "sha256:b"};
  try {
    queue.submit(table, job);
    FAIL() << "was accepted";
  } catch (const MissingInputs& missing) {
    EXPECT_THAT(missing.digests(), ElementsAre("sha256:b", "sha256:a"));
  }
}

}  // namespace
}  // namespace saltus::server
