#include "server/jobs/lease_table.h"
#include "tests/support/server_fakes.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace saltus::server {
namespace {

using namespace std::chrono_literals;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using Wanted = LeaseTable::Wanted;

class LeaseTableTest : public ::testing::Test {
 protected:
  testing_support::FakeClock clock;
  LeaseTable leases{30s, {1000ms, 1600ms}, 60s};
  const AttemptKey key{"job", 1};
  SteadyTime now() const { return clock.steady(); }
};

TEST_F(LeaseTableTest, ExpiresExactlyAfterItsLengthAndOnlyOnce) {
  leases.grant(key, "#t", now());
  clock.advance(30s - 1ms);
  EXPECT_THAT(leases.due(now()).expired, IsEmpty());
  clock.advance(1ms);
  EXPECT_THAT(leases.due(now()).expired, ElementsAre(key));
  EXPECT_THAT(leases.due(now()).expired, IsEmpty());
}

TEST_F(LeaseTableTest, ARenewalProlongsIt) {
  leases.grant(key, "#t", now());
  clock.advance(29s);
  EXPECT_EQ(leases.renew(key, "#t", now()), Wanted::Continue);
  clock.advance(29s);
  EXPECT_THAT(leases.due(now()).expired, IsEmpty());
}

TEST_F(LeaseTableTest, NothingIsRenewedForAStranger) {
  leases.grant(key, "#t", now());
  EXPECT_EQ(leases.renew(key, "#other", now()), std::nullopt);
  EXPECT_EQ(leases.renew({"job", 2}, "#t", now()), std::nullopt);
  EXPECT_EQ(leases.renew({"other", 1}, "#t", now()), std::nullopt);
}

TEST_F(LeaseTableTest, AnExpiredLeaseCannotBeRenewed) {
  leases.grant(key, "#t", now());
  clock.advance(30s);
  leases.due(now());
  EXPECT_EQ(leases.renew(key, "#t", now()), std::nullopt);
}

TEST_F(LeaseTableTest, AnExpiryThatCouldNotBeRecordedIsReportedAgain) {
  leases.grant(key, "#t", now());
  clock.advance(30s);
  leases.due(now());
  leases.retry_end(key, now());
  EXPECT_THAT(leases.due(now()).expired, IsEmpty());
  clock.advance(30s);
  EXPECT_THAT(leases.due(now()).expired, ElementsAre(key));
}

TEST_F(LeaseTableTest, ACancelGoesFromAskingToTerminatingToKilling) {
  leases.grant(key, "#t", now());
  leases.cancel("job", now());
  EXPECT_EQ(leases.renew(key, "#t", now()), Wanted::Cancel);
  clock.advance(999ms);
  EXPECT_THAT(leases.due(now()).terminate, IsEmpty());
  clock.advance(1ms);
  EXPECT_THAT(leases.due(now()).terminate, ElementsAre(key));
  clock.advance(599ms);
  EXPECT_THAT(leases.due(now()).kill, IsEmpty());
  clock.advance(1ms);
  const auto due = leases.due(now());
  EXPECT_THAT(due.kill, ElementsAre(key));
  EXPECT_THAT(due.terminate, IsEmpty());
  EXPECT_THAT(leases.due(now()).kill, IsEmpty());
}

TEST_F(LeaseTableTest, ASecondCancelDoesNotBeginTheLadderAnew) {
  leases.grant(key, "#t", now());
  leases.cancel("job", now());
  clock.advance(999ms);
  leases.cancel("job", now());
  clock.advance(1ms);
  EXPECT_THAT(leases.due(now()).terminate, ElementsAre(key));
}

TEST_F(LeaseTableTest, TheEndOfAnOldAttemptLeavesTheNewOne) {
  leases.grant({"job", 2}, "#t", now());
  leases.end(key);
  EXPECT_EQ(leases.size(), 1);
}

class AliveLeaseTest : public LeaseTableTest {
 protected:
  /// A heartbeat each second.
  void beat(std::chrono::seconds time, const JobProgress& progress) {
    for (auto passed = 0s; passed < time; passed += 1s) {
      clock.advance(1s);
      ASSERT_TRUE(leases.renew(key, "#t", now()).has_value());
      leases.progressed(key, progress, now());
      if (passed + 1s < time) {
        EXPECT_THAT(leases.due(now()).stalled, IsEmpty());
      }
    }
  }
  static JobProgress at(int level, int iteration) {
    JobProgress progress;
    progress.stage = JobStage::Optimising;
    progress.level = level;
    progress.iteration = iteration;
    return progress;
  }
};

TEST_F(AliveLeaseTest, AnAttemptThatStandsStillIsReportedOnceHoweverAliveItsHeartbeat) {
  leases.grant(key, "#t", now());
  beat(1s, at(1, 5));
  beat(60s, at(1, 5));
  EXPECT_THAT(leases.due(now()).stalled, ElementsAre(key));
  EXPECT_THAT(leases.due(now()).stalled, IsEmpty());
  EXPECT_FALSE(leases.renew(key, "#t", now()).has_value());
}

TEST_F(AliveLeaseTest, EveryStepOfStageLevelOrIterationCounts) {
  leases.grant(key, "#t", now());
  for (const JobProgress& progress : {at(1, 5), at(1, 6), at(2, 6), JobProgress{.stage = JobStage::Writing}})
    beat(59s, progress);
  EXPECT_THAT(leases.due(now()).stalled, IsEmpty());
}

TEST_F(AliveLeaseTest, OtherNumbersDoNotHideAStandstill) {
  leases.grant(key, "#t", now());
  JobProgress progress = at(1, 5);
  beat(1s, progress);
  progress.cpu_seconds = 50;
  progress.energy = 3;
  progress.fraction = 0.5;
  beat(60s, progress);
  EXPECT_THAT(leases.due(now()).stalled, ElementsAre(key));
}

TEST_F(AliveLeaseTest, AJobThatIsBeingCancelledDoesNotStall) {
  leases.grant(key, "#t", now());
  leases.cancel(key.job_id, now());
  beat(60s, at(1, 5));
  EXPECT_THAT(leases.due(now()).stalled, IsEmpty());
}

TEST_F(AliveLeaseTest, TheWallTimeOfAnAttemptEnds) {
  leases.grant(key, "#t", now(), {.wall_seconds = 20});
  beat(19s, at(1, 1));
  EXPECT_THAT(leases.due(now()).over_limit, IsEmpty());
  beat(1s, at(1, 2));
  EXPECT_THAT(leases.due(now()).over_limit, ElementsAre(std::pair(key, Limit::WallTime)));
  EXPECT_THAT(leases.due(now()).over_limit, IsEmpty());
}

TEST_F(AliveLeaseTest, WallTimeUsedBeforeARestartCounts) {
  leases.grant(key, "#t", now(), {.wall_seconds = 20}, 15s);
  clock.advance(5s);
  EXPECT_THAT(leases.due(now()).over_limit, ElementsAre(std::pair(key, Limit::WallTime)));
}

TEST_F(AliveLeaseTest, ProcessorTimeAndMemoryAreThoseThatTheWorkerReports) {
  JobProgress progress = at(1, 1);
  progress.cpu_seconds = 100;
  progress.memory_bytes = 1000;
  leases.grant(key, "#t", now(), {.cpu_seconds = 100, .memory_bytes = 1000});
  beat(1s, progress);
  EXPECT_THAT(leases.due(now()).over_limit, IsEmpty());
  progress.cpu_seconds = 100.5;
  beat(1s, progress);
  EXPECT_THAT(leases.due(now()).over_limit, ElementsAre(std::pair(key, Limit::CpuTime)));

  leases.grant({"job", 2}, "#t", now(), {.memory_bytes = 999});
  leases.progressed({"job", 2}, progress, now());
  EXPECT_THAT(leases.due(now()).over_limit, ElementsAre(std::pair(AttemptKey{"job", 2}, Limit::Memory)));
}

TEST_F(AliveLeaseTest, AStandstillThatCouldNotBeRecordedIsReportedAgain) {
  leases.grant(key, "#t", now());
  beat(60s, {});
  EXPECT_THAT(leases.due(now()).stalled, ElementsAre(key));
  leases.retry_end(key, now());
  EXPECT_THAT(leases.due(now()).stalled, IsEmpty());
  beat(30s, {});
  EXPECT_THAT(leases.due(now()).stalled, ElementsAre(key));
}

}  // namespace
}  // namespace saltus::server
