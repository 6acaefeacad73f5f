#include "server/jobs/budget.h"

#include <gtest/gtest.h>

namespace saltus::server {
namespace {

const AttemptKey kFirst{"a", 1}, kSecond{"b", 1};

TEST(Budget, AddsUpThreadsMemoryAndWorkers) {
  Budget budget(3, {.threads = 4, .memory_bytes = 100});
  budget.take(kFirst, {.threads = 2, .memory_bytes = 40});
  EXPECT_TRUE(budget.fits({.threads = 2, .memory_bytes = 60}));
  EXPECT_FALSE(budget.fits({.threads = 3, .memory_bytes = 1}));
  EXPECT_FALSE(budget.fits({.threads = 1, .memory_bytes = 61}));
  budget.take(kSecond, {.threads = 1, .memory_bytes = 1});
  budget.take({"c", 1}, {.threads = 1, .memory_bytes = 1});
  EXPECT_FALSE(budget.fits({.threads = 0, .memory_bytes = 0}));
  budget.ended(kSecond, false);
  EXPECT_TRUE(budget.fits({.threads = 1, .memory_bytes = 59}));
}

TEST(Budget, WhatIsLargerThanAllThereIsRunsAlone) {
  Budget budget(2, {.threads = 4, .memory_bytes = 100});
  const Demand large{.threads = 1, .memory_bytes = 101};
  EXPECT_TRUE(budget.is_too_large(large));
  EXPECT_TRUE(budget.fits(large));
  budget.take(kFirst, {.threads = 1, .memory_bytes = 1});
  EXPECT_FALSE(budget.fits(large));
}

TEST(Budget, AProcessThatIsEndedByForceHoldsItsShareUntilItIsGone) {
  Budget budget(1, {.threads = 1, .memory_bytes = 1});
  budget.take(kFirst, {});
  budget.has_process(kFirst);
  budget.ended(kFirst, true);
  EXPECT_FALSE(budget.fits({}));
  budget.exited(kFirst);
  EXPECT_TRUE(budget.fits({}));
}

TEST(Budget, AnAttemptWithoutAProcessHoldsNothingAfterItsEnd) {
  Budget budget(1, {.threads = 1, .memory_bytes = 1});
  budget.take(kFirst, {});
  budget.ended(kFirst, true);
  EXPECT_TRUE(budget.fits({}));
}

}  // namespace
}  // namespace saltus::server
