#include "server/observe/metrics.h"

#include "tests/support/temporary_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace saltus::server {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

JobRecord job(JobState state, int attempt, int lost = 0) {
  JobRecord job;
  job.id = "0123-abcd";
  job.state = state;
  job.attempt = attempt;
  job.lost_attempts = lost;
  job.created = WallTime(std::chrono::seconds(1000));
  if (attempt > 0) job.started = job.created + std::chrono::seconds(7);
  if (is_terminal(state)) job.ended = job.created + std::chrono::seconds(20);
  return job;
}

TEST(JobHistory, TellsStepsFromRecordsOnceEach) {
  JobHistory history;
  using Kind = JobStep::Kind;
  const auto kind = [&](const JobRecord& record) {
    const auto step = history.changed(record);
    return step ? std::optional(step->kind) : std::nullopt;
  };
  EXPECT_EQ(kind(job(JobState::Queued, 0)), Kind::Queued);
  EXPECT_EQ(kind(job(JobState::Queued, 0)), std::nullopt);
  EXPECT_EQ(kind(job(JobState::Running, 1)), Kind::Started);
  EXPECT_EQ(kind(job(JobState::Running, 1)), std::nullopt);
  EXPECT_EQ(history.count(JobState::Running), 1);
  const auto requeued = history.changed(job(JobState::Queued, 1, 1));
  ASSERT_TRUE(requeued);
  EXPECT_EQ(requeued->kind, Kind::Requeued);
  EXPECT_TRUE(requeued->has_lost_attempt);
  EXPECT_EQ(kind(job(JobState::Running, 2, 1)), Kind::Started);
  EXPECT_EQ(kind(job(JobState::Cancelling, 2, 1)), Kind::Cancelling);
  const auto ended = history.changed(job(JobState::Cancelled, 2, 1));
  ASSERT_TRUE(ended);
  EXPECT_EQ(ended->kind, Kind::Ended);
  EXPECT_FALSE(ended->has_lost_attempt);
  EXPECT_EQ(kind(job(JobState::Cancelled, 2, 1)), std::nullopt);
  for (const JobState state : {JobState::Queued, JobState::Running, JobState::Cancelling})
    EXPECT_EQ(history.count(state), 0);
}

TEST(JobHistory, StartsFromWhatIsThere) {
  JobHistory history;
  history.seed(job(JobState::Running, 1));
  history.seed(job(JobState::Running, 1));
  EXPECT_EQ(history.count(JobState::Running), 1);
  EXPECT_EQ(history.changed(job(JobState::Succeeded, 1))->kind, JobStep::Kind::Ended);
  history.seed(job(JobState::Queued, 0));
  history.deleted("0123-abcd");
  EXPECT_EQ(history.count(JobState::Queued), 0);
}

class MetricsTest : public ::testing::Test {
 protected:
  testing_support::TemporaryFolder folder;
  Metrics metrics{"1.2.3", folder.path()};
};

TEST_F(MetricsTest, CountCalls) {
  CallRecord call;
  call.method = "/s/M";
  call.code = "NOT_FOUND";
  call.time = std::chrono::milliseconds(3);
  metrics.call_began("/s/M");
  EXPECT_THAT(metrics.text(), HasSubstr("saltusd_rpc_open{method=\"/s/M\"} 1"));
  metrics.call_ended(call);
  const std::string text = metrics.text();
  EXPECT_THAT(text, HasSubstr("saltusd_rpc_open{method=\"/s/M\"} 0"));
  EXPECT_THAT(text, HasSubstr("saltusd_rpc_total{code=\"NOT_FOUND\",method=\"/s/M\"} 1"));
  EXPECT_THAT(text, HasSubstr("saltusd_rpc_seconds_bucket{method=\"/s/M\",le=\"0.0025\"} 0"));
  EXPECT_THAT(text, HasSubstr("saltusd_rpc_seconds_bucket{method=\"/s/M\",le=\"0.005\"} 1"));
  EXPECT_THAT(text, HasSubstr("saltusd_build_info{version=\"1.2.3\"} 1"));
  EXPECT_THAT(text, HasSubstr("saltusd_disk_free_bytes"));
}

TEST_F(MetricsTest, CountJobsAndAttempts) {
  using Kind = JobStep::Kind;
  metrics.job_stepped(job(JobState::Queued, 0), {Kind::Queued, false});
  metrics.job_stepped(job(JobState::Running, 1), {Kind::Started, false});
  JobRecord lost = job(JobState::Queued, 1, 1);
  lost.last_loss = JobFailure{"LEASE_EXPIRED", ""};
  metrics.job_stepped(lost, {Kind::Requeued, true});
  metrics.job_stepped(job(JobState::Running, 2, 1), {Kind::Started, false});
  metrics.job_stepped(job(JobState::Succeeded, 2, 1), {Kind::Ended, false});
  metrics.jobs_are(4, 2, 1);
  const std::string text = metrics.text();
  for (const char* line :
       {"saltusd_jobs_submitted_total 1", "saltusd_attempts_started_total 2",
        "saltusd_attempts_total{outcome=\"lost\"} 1", "saltusd_attempts_total{outcome=\"succeeded\"} 1",
        "saltusd_lease_lost_total 1", "saltusd_queue_wait_seconds_count 1", "saltusd_queue_wait_seconds_sum 7",
        "saltusd_job_seconds_sum{outcome=\"succeeded\"} 20", "saltusd_jobs{state=\"queued\"} 4",
        "saltusd_jobs{state=\"running\"} 2", "saltusd_jobs{state=\"cancelling\"} 1"})
    EXPECT_THAT(text, HasSubstr(line));
  EXPECT_THAT(text, Not(HasSubstr("0123-abcd"))) << "no job id in a label";
}

}  // namespace
}  // namespace saltus::server
