#include "server/jobs/watch_hub.h"

#include <gtest/gtest.h>

namespace saltus::server {
namespace {

using Kind = Subscription::Event::Kind;

JobRecord job_in(JobState state) {
  JobRecord job;
  job.id = "job";
  job.state = state;
  return job;
}

JobProgress at_iteration(int iteration) {
  JobProgress progress;
  progress.iteration = iteration;
  return progress;
}

TEST(WatchHub, KeepsEveryStateChangeAndOnlyTheLatestProgress) {
  WatchHub hub;
  const auto watcher = hub.subscribe("job", [] {});
  hub.changed(job_in(JobState::Running));
  hub.changed(job_in(JobState::Cancelling));
  for (int i = 0; i < 1000; ++i) hub.progressed("job", at_iteration(i));
  EXPECT_EQ(watcher->next()->job.state, JobState::Running);
  EXPECT_EQ(watcher->next()->job.state, JobState::Cancelling);
  EXPECT_EQ(watcher->next()->progress.iteration, 999);
  EXPECT_FALSE(watcher->next().has_value());
}

TEST(WatchHub, ProgressOfAnEarlierStateIsNotToldAfterTheChange) {
  WatchHub hub;
  const auto watcher = hub.subscribe("job", [] {});
  hub.progressed("job", at_iteration(7));
  hub.changed(job_in(JobState::Queued));
  EXPECT_EQ(watcher->next()->kind, Kind::Changed);
  EXPECT_FALSE(watcher->next().has_value());
}

TEST(WatchHub, WakesOnlyTheWatchersOfTheJobAndNoneThatHasEnded) {
  WatchHub hub;
  int woken = 0, others = 0, ended = 0;
  const auto watcher = hub.subscribe("job", [&] { ++woken; });
  const auto other = hub.subscribe("other", [&] { ++others; });
  const auto gone = hub.subscribe("job", [&] { ++ended; });
  hub.end(gone);
  hub.changed(job_in(JobState::Running));
  hub.progressed("job", at_iteration(1));
  EXPECT_EQ(woken, 2);
  EXPECT_EQ(others, 0);
  EXPECT_EQ(ended, 0);
}

TEST(WatchHub, ADeletionIsToldAfterTheChangesBeforeIt) {
  WatchHub hub;
  const auto watcher = hub.subscribe("job", [] {});
  hub.changed(job_in(JobState::Cancelled));
  hub.deleted("job");
  EXPECT_EQ(watcher->next()->kind, Kind::Changed);
  EXPECT_EQ(watcher->next()->kind, Kind::Deleted);
}

}  // namespace
}  // namespace saltus::server
