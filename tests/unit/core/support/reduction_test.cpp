#include "core/support/reduction.h"

#include <gtest/gtest.h>
#include <omp.h>

#include <cmath>

#include "tests/support/many_threads.h"

namespace saltus {
namespace {

// Oracle: closed form; whole numbers are summed exactly, floats too where eight of them stay below 2^24. Lengths around
// a lane's, eight lanes' and a block's end.
TEST(OrderedSum, TakesEachTermOnce) {
  for (std::size_t count : {0u, 1u, 15u, 16u, 17u, 127u, 128u, 129u, 145u, 4095u, 4096u, 4097u, 4111u, 20000u}) {
    const double sum = 0.5 * static_cast<double>(count) * static_cast<double>(count + 1);
    EXPECT_EQ(ordered_sum(count, [](std::size_t i) { return static_cast<double>(i + 1); }), sum) << count;
    EXPECT_EQ(ordered_sum(count, [](std::size_t i) { return static_cast<float>(i + 1); }), sum) << count;
  }
}

// Oracle: the bound that the header states, on terms that nearly cancel.
TEST(OrderedSum, OfFloatsIsAsGoodAsItSays) {
  constexpr std::size_t count = 100001;
  const auto term = [](std::size_t i) { return std::sin(static_cast<float>(i) * 0.7f); };
  double sum = 0, size = 0;
  for (std::size_t i = 0; i < count; ++i) {
    sum += static_cast<double>(term(i));
    size += std::abs(static_cast<double>(term(i)));
  }
  EXPECT_NEAR(ordered_sum(count, term), sum, 5e-7 * size);
}

// Oracle: the same bits.
TEST(OrderedSum, DoesNotDependOnTheNumberOfThreads) {
  const testing::ManyThreads many;
  const auto sum = [](int threads, auto one) {
    omp_set_num_threads(threads);
    return ordered_sum(50001, [](std::size_t i) { return std::sin(static_cast<decltype(one)>(i)) / 3; });
  };
  const double alone = sum(1, 1.0), of_floats = sum(1, 1.0f);
  for (int threads : {2, 3, 8}) {
    EXPECT_EQ(sum(threads, 1.0), alone) << threads;
    EXPECT_EQ(sum(threads, 1.0f), of_floats) << threads;
  }
}

}  // namespace
}  // namespace saltus
