#include "server/jobs/start_estimate.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace saltus::server {
namespace {

using namespace std::chrono_literals;

const WallTime kNow{std::chrono::hours(1000)};

TEST(StartEstimate, FreePlacesAreTakenAtOnce) {
  EXPECT_EQ(estimate_start(1, {kNow - 5s}, 2, 60s, kNow), kNow);
  EXPECT_EQ(estimate_start(2, {kNow - 5s}, 2, 60s, kNow), kNow + 55s);
  EXPECT_EQ(estimate_start(3, {kNow - 5s}, 2, 60s, kNow), kNow + 60s);
  EXPECT_EQ(estimate_start(4, {kNow - 5s}, 2, 60s, kNow), kNow + 115s);
}

TEST(StartEstimate, AJobThatTakesLongerThanUsualIsAboutToEnd) {
  EXPECT_EQ(estimate_start(1, {kNow - 500s}, 1, 60s, kNow), kNow);
  EXPECT_EQ(estimate_start(2, {kNow - 500s}, 1, 60s, kNow), kNow + 60s);
}

// The oracle runs the jobs one by one.
TEST(StartEstimate, IsWhatASimulationSays) {
  const std::vector<WallTime> running = {kNow - 7s, kNow - 31s, kNow - 90s};
  const auto typical = 40s;
  std::vector<WallTime> ends = {kNow + 33s, kNow + 9s, kNow, kNow};
  for (int position = 1; position < 30; ++position) {
    const auto first = std::min_element(ends.begin(), ends.end());
    EXPECT_EQ(estimate_start(position, running, 4, typical, kNow), *first) << position;
    *first += typical;
  }
}

TEST(RecentDurations, TheMedianOfTheLastOnesIsTypical) {
  RecentDurations durations;
  EXPECT_FALSE(durations.typical().has_value());
  for (const auto duration : {10s, 1000s, 20s}) durations.add(duration);
  EXPECT_EQ(durations.typical(), 20s);
  for (int i = 0; i < 32; ++i) durations.add(3s);
  EXPECT_EQ(durations.typical(), 3s);
}

}  // namespace
}  // namespace saltus::server
