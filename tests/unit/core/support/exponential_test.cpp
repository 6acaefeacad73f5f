#include "core/support/exponential.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

namespace saltus {
namespace {

TEST(Exponential, IsThatOfTheLibraryInSinglePrecision) {
  std::vector<float> at, found;
  for (int i = 0; i <= 1000000; ++i) at.push_back(-87 + 175.5f * static_cast<float>(i) / 1000000);
  found.resize(at.size());
#pragma omp simd
  for (std::size_t i = 0; i < at.size(); ++i) found[i] = exponential(at[i]);
  double worst = 0;
  for (std::size_t i = 0; i < at.size(); ++i) {
    const double expected = std::exp(static_cast<double>(at[i]));
    worst = std::max(worst, std::abs(static_cast<double>(found[i]) - expected) / expected);
  }
  EXPECT_LT(worst, 2e-7);
  EXPECT_EQ(exponential(0.0f), 1.0f);
}

TEST(Exponential, IsBoundedWhereSinglePrecisionEnds) {
  constexpr float infinity = std::numeric_limits<float>::infinity();
  for (float x : {-88.0f, -1e30f, -infinity}) EXPECT_EQ(exponential(x), exponential(-87.0f)) << x;
  for (float x : {89.0f, 1e30f, infinity}) EXPECT_EQ(exponential(x), exponential(88.5f)) << x;
  for (std::uint32_t no_number : {0x7fc00000u, 0x7fc00001u, 0x7fffffffu, 0xffffffffu})
    EXPECT_TRUE(std::isnan(exponential(std::bit_cast<float>(no_number)))) << no_number;
}

}  // namespace
}  // namespace saltus
