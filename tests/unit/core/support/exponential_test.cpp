#include "core/support/exponential.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace saltus {
namespace {

TEST(Exponential, IsThatOfTheLibraryInSinglePrecision) {
  double worst = 0;
  for (int i = 0; i <= 1000000; ++i) {
    const float x = -87 + 175.5f * static_cast<float>(i) / 1000000;
    const double expected = std::exp(static_cast<double>(x));
    worst = std::max(worst, std::abs(static_cast<double>(exponential(x)) - expected) / expected);
  }
  EXPECT_LT(worst, 2e-7);
  EXPECT_EQ(exponential(0.0f), 1.0f);
}

TEST(Exponential, IsBoundedWhereSinglePrecisionEnds) {
  constexpr float infinity = std::numeric_limits<float>::infinity();
  for (float x : {-88.0f, -1e30f, -infinity}) EXPECT_EQ(exponential(x), exponential(-87.0f)) << x;
  for (float x : {89.0f, 1e30f, infinity}) EXPECT_EQ(exponential(x), exponential(88.5f)) << x;
  EXPECT_TRUE(std::isnan(exponential(std::numeric_limits<float>::quiet_NaN())));
}

}  // namespace
}  // namespace saltus
