#include "server/jobs/waiting_list.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

namespace saltus::server {
namespace {

using namespace std::chrono_literals;
using ::testing::ElementsAre;

class WaitingListTest : public ::testing::Test {
 protected:
  void put(const std::string& id, const std::string& submitter = "ann", int priority = kDefaultPriority,
           Demand demand = {}) {
    WaitingJob job;
    job.id = id;
    job.submitter = submitter;
    job.sequence = ++last_sequence;
    job.priority = priority;
    job.demand = demand;
    job.created = now;
    list.put(job);
  }
  /// Starts the next job that needs at most `room` threads; "" when there is none.
  std::string start(int room = 1) {
    const auto next = list.next(
        now, steady, [room](const Demand& demand) { return demand.threads <= room ? Fit::Yes : Fit::NotNow; });
    if (!next) return "";
    list.started(next->id);
    list.remove(next->id);
    return next->id;
  }
  std::vector<std::string> start_all() {
    std::vector<std::string> ids;
    while (list.size() > 0) ids.push_back(start());
    return ids;
  }

  WaitingList list{{.promotion = 30min, .most_overtakes = 3, .look_ahead = 10}};
  WallTime now{std::chrono::hours(1000)};
  SteadyTime steady{std::chrono::hours(1)};
  std::int64_t last_sequence = 0;
};

TEST_F(WaitingListTest, TheOlderJobOfASubmitterIsFirst) {
  for (const char* id : {"a", "b", "c"}) put(id);
  EXPECT_THAT(start_all(), ElementsAre("a", "b", "c"));
}

TEST_F(WaitingListTest, SubmittersTakeTurns) {
  for (const char* id : {"a1", "a2", "a3"}) put(id, "ann");
  for (const char* id : {"b1", "b2"}) put(id, "bob");
  EXPECT_THAT(start_all(), ElementsAre("a1", "b1", "a2", "b2", "a3"));
}

TEST_F(WaitingListTest, WhoHadNoTurnYetIsBeforeWhoHadOne) {
  for (const char* id : {"a1", "a2", "a3"}) put(id, "ann");
  EXPECT_EQ(start(), "a1");
  put("b1", "bob");
  EXPECT_EQ(start(), "b1");
  EXPECT_EQ(start(), "a2");
}

TEST_F(WaitingListTest, PrioritiesAreBeforeTurns) {
  put("a-low", "ann", 0);
  put("a", "ann", 1);
  put("b-high-1", "bob", 2);
  put("b-high-2", "bob", 2);
  EXPECT_THAT(start_all(), ElementsAre("b-high-1", "b-high-2", "a", "a-low"));
}

TEST_F(WaitingListTest, ALowPriorityRisesAndIsNotStarved) {
  put("low", "ann", 0);
  now += 30min;
  put("normal", "bob", 1);
  EXPECT_EQ(start(), "low");  // of the same rank now, and ann had no turn later than bob
  EXPECT_EQ(start(), "normal");
  put("low again", "ann", 0);
  now += 60min;
  // However many important jobs come, the old one is among them now.
  for (int i = 0; i < 5; ++i) put("high " + std::to_string(i), "bob", 2);
  EXPECT_EQ(start(), "low again");
  EXPECT_EQ(start(), "high 0");
}

TEST_F(WaitingListTest, PromotionHappensExactlyAfterItsTime) {
  put("low", "ann", 0);
  now += 30min - 1ms;
  put("normal", "ann", 1);
  EXPECT_EQ(list.position("low", now), 2);
  now += 1ms;
  EXPECT_EQ(list.position("low", now), 1);
}

TEST_F(WaitingListTest, AJobThatIsNotReadyIsLeftOut) {
  WaitingJob job;
  job.id = "retry";
  job.submitter = "ann";
  job.ready = steady + 5s;
  list.put(job);
  put("other");
  EXPECT_EQ(start(), "other");
  EXPECT_EQ(start(), "");
  steady += 5s;
  EXPECT_EQ(start(), "retry");
}

TEST_F(WaitingListTest, ALargeJobIsOvertakenOnlySoOften) {
  put("large", "ann", 1, {.threads = 2});
  for (int i = 0; i < 5; ++i) put("small " + std::to_string(i));
  for (int i = 0; i < 3; ++i) EXPECT_EQ(start(), "small " + std::to_string(i));
  EXPECT_EQ(start(), "");
  EXPECT_EQ(start(2), "large");
  EXPECT_EQ(start(), "small 3");
}

TEST_F(WaitingListTest, LookingWithoutStartingIsNoOvertaking) {
  put("large", "ann", 1, {.threads = 2});
  put("small");
  for (int i = 0; i < 10; ++i)
    EXPECT_EQ(
        list.next(now, steady, [](const Demand& demand) { return demand.threads == 1 ? Fit::Yes : Fit::NotNow; })->id,
        "small");
  EXPECT_EQ(start(), "small");
}

TEST_F(WaitingListTest, WhatIsPutAgainIsChangedAndNotDoubled) {
  put("a");
  WaitingJob job;
  job.id = "a";
  job.submitter = "ann";
  job.sequence = 1;
  job.demand = {.threads = 2};
  list.put(job);
  EXPECT_EQ(list.size(), 1);
  EXPECT_EQ(start(1), "");
  EXPECT_EQ(start(2), "a");
}

TEST_F(WaitingListTest, WhoDoesNotWaitHasNoPlace) {
  put("a");
  EXPECT_EQ(list.position("b", now), 0);
  list.remove("b");
  list.remove("a");
  list.remove("a");
  EXPECT_EQ(list.position("a", now), 0);
  EXPECT_EQ(list.size(), 0);
}

TEST_F(WaitingListTest, WhoHadATurnBeforeTheListWasMadeWaitsForTheOthers) {
  put("ann 1", "ann");
  put("bob 1", "bob");
  put("eve 1", "eve");
  put("ann high", "ann", kHighestPriority);
  put("bob high", "bob", kHighestPriority);
  list.had_turn("bob", kDefaultPriority);
  list.had_turn("ann", kDefaultPriority);
  list.had_turn("ann", kHighestPriority);
  for (const char* next : {"bob high", "ann high", "eve 1", "bob 1", "ann 1"}) EXPECT_EQ(start(), next);
}

// The oracle is the order in which the jobs really start.
TEST_F(WaitingListTest, PositionsAreTheOrderOfTheStarts) {
  std::mt19937 random(4711);
  const auto pick = [&](int count) { return static_cast<int>(random() % static_cast<unsigned>(count)); };
  for (int round = 0; round < 50; ++round) {
    const int jobs = 1 + pick(40);
    std::vector<std::string> ids;
    for (int i = 0; i < jobs; ++i) {
      ids.push_back("job " + std::to_string(round) + "." + std::to_string(i));
      put(ids.back(), std::string(1, static_cast<char>('a' + pick(4))), pick(3));
      now += std::chrono::minutes(pick(10));
    }
    for (int i = 0; i < pick(5) && list.size() > 1; ++i) start();
    std::map<int, std::string> expected;
    for (const std::string& id : ids)
      if (const int position = list.position(id, now)) expected[position] = id;
    ASSERT_EQ(static_cast<int>(expected.size()), list.size());
    for (const auto& [position, id] : expected) {
      EXPECT_EQ(list.position(id, now), 1);
      ASSERT_EQ(start(), id) << "position " << position;
    }
  }
}

TEST_F(WaitingListTest, WhatIsNotForTheOneWhoAsksIsNotOvertaken) {
  put("large", "ann", kDefaultPriority, {4, 0});
  for (int i = 0; i < 20; ++i) put("small " + std::to_string(i), "ann", kDefaultPriority, {1, 0});
  const auto fits = [](const Demand& demand) { return demand.threads == 1 ? Fit::Yes : Fit::NotHere; };
  for (int i = 0; i < 20; ++i) {
    const auto next = list.next(now, steady, fits);
    ASSERT_TRUE(next);
    list.started(next->id);
    list.remove(next->id);
  }
  EXPECT_FALSE(list.next(now, steady, fits));
  EXPECT_EQ(list.next(now, steady, [](const Demand&) { return Fit::Yes; })->id, "large");
}

}  // namespace
}  // namespace saltus::server
