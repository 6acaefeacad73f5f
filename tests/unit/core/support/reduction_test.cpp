#include "core/support/reduction.h"

#include <gtest/gtest.h>
#include <omp.h>

#include <cmath>

#include "tests/support/many_threads.h"

namespace saltus {
namespace {

// Oracle: closed form; whole numbers are summed exactly. Lengths around a lane's and a block's end.
TEST(OrderedSum, TakesEachTermOnce) {
  for (std::size_t count : {0u, 1u, 15u, 16u, 17u, 4095u, 4096u, 4097u, 4111u, 20000u})
    EXPECT_EQ(ordered_sum(count, [](std::size_t i) { return static_cast<double>(i + 1); }),
              0.5 * static_cast<double>(count) * static_cast<double>(count + 1))
        << count;
}

// Oracle: the same bits.
TEST(OrderedSum, DoesNotDependOnTheNumberOfThreads) {
  const testing::ManyThreads many;
  const auto sum = [](int threads) {
    omp_set_num_threads(threads);
    return ordered_sum(50001, [](std::size_t i) { return std::sin(static_cast<double>(i)) / 3; });
  };
  const double alone = sum(1);
  for (int threads : {2, 3, 8}) EXPECT_EQ(sum(threads), alone) << threads;
}

}  // namespace
}  // namespace saltus
