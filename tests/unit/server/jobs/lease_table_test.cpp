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
  LeaseTable leases{30s, {1000ms, 1600ms}};
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
  leases.retry_expiry(key, now());
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

}  // namespace
}  // namespace saltus::server
