#include "core/support/thread_count.h"

#include <gtest/gtest.h>

namespace saltus {
namespace {

// Not some of them: the pool would end the others.
TEST(ThreadCount, GivesALoopOneThreadOrAll) {
  const ThreadCount four(4);
  const std::size_t each = sites_a_thread.loop;
  EXPECT_EQ(threads_of_loop(0), 1);
  EXPECT_EQ(threads_of_loop(4 * each - 1), 1);
  EXPECT_EQ(threads_of_loop(4 * each), 4);
  EXPECT_EQ(threads_of_loop(100 * each), 4);
  EXPECT_FALSE(is_worth_threads(4 * each - 1));
  EXPECT_TRUE(is_worth_threads(4 * each));
}

TEST(ThreadCount, GivesALevelAsManyAsItsSitesKeepBusy) {
  const ThreadCount four(4);
  const std::size_t each = sites_a_thread.level;
  EXPECT_EQ(threads_of_level(0), 1);
  EXPECT_EQ(threads_of_level(3 * each), 3);
  EXPECT_EQ(threads_of_level(100 * each), 4);
}

}  // namespace
}  // namespace saltus
