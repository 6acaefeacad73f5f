#include "core/evaluation/statistics.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace saltus {
namespace {

// Oracle: by hand. numpy gives the same: np.percentile([1, 2, 3, 10], 90) = 7.9.
TEST(Statistics, AreThoseOfASmallSample) {
  const Statistics statistics = summarise({10, 1, 3, 2});
  EXPECT_EQ(statistics.n, 4u);
  EXPECT_DOUBLE_EQ(statistics.mean, 4);
  EXPECT_DOUBLE_EQ(statistics.sd, std::sqrt((9.0 + 4 + 1 + 36) / 4));
  EXPECT_DOUBLE_EQ(statistics.median, 2.5);
  EXPECT_NEAR(statistics.p90, 3 + 0.7 * 7, 1e-12);
  EXPECT_DOUBLE_EQ(statistics.max, 10);
}

TEST(Statistics, OfOneValueAndOfNone) {
  const Statistics one = summarise({7});
  EXPECT_EQ(one.mean, 7);
  EXPECT_EQ(one.sd, 0);
  EXPECT_EQ(one.p90, 7);
  EXPECT_EQ(summarise({}).n, 0u);
}

// Oracle: sorting.
TEST(Statistics, QuantilesNeedNoOrder) {
  std::mt19937 random(5);
  for (const std::size_t count : {1u, 2u, 3u, 100u, 101u}) {
    std::vector<double> values(count);
    for (double& value : values) value = static_cast<double>(random() % 50) / 7;  // some of them equal
    std::vector<double> sorted = values;
    std::sort(sorted.begin(), sorted.end());
    for (const double quantile : {0.0, 0.002, 0.5, 0.9, 0.99, 1.0}) {
      std::shuffle(values.begin(), values.end(), random);
      EXPECT_EQ(quantile_of(values, quantile), quantile_of_sorted(sorted, quantile)) << count << ", " << quantile;
    }
  }
}

}  // namespace
}  // namespace saltus
