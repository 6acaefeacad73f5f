#include "core/evaluation/statistics.h"

#include <gtest/gtest.h>

#include <cmath>

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

}  // namespace
}  // namespace saltus
