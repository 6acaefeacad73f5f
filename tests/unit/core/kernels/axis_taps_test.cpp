// Oracle: the taps themselves, put together again from the rows that mirror themselves.
#include "core/kernels/axis_taps.h"

#include <gtest/gtest.h>

#include <map>

#include "core/kernels/kernel_profile.h"

namespace saltus {
namespace {

/// Tap t by t, as the parts make them.
std::map<int, double> put_together(const AxisTaps<double>& taps) {
  std::map<int, double> sum;
  for (const MirroredTaps<double>& part : taps.parts()) {
    sum[0] += part.middle;
    for (std::size_t k = 0; k < part.sides.size(); ++k) {
      sum[part.before + static_cast<int>(k)] += part.sides[k];
      sum[-part.after - static_cast<int>(k)] += part.kind == Mirror::Even ? part.sides[k] : -part.sides[k];
    }
  }
  return sum;
}

void expect_taps(const std::vector<double>& row, std::size_t parts) {
  const AxisTaps<double> taps(row);
  EXPECT_EQ(taps.parts().size(), parts);
  EXPECT_EQ(taps.radius(), static_cast<int>(row.size() / 2));
  std::map<int, double> sum = put_together(taps);
  for (int t = -taps.radius(); t <= taps.radius(); ++t)
    EXPECT_NEAR(sum[t], row[static_cast<std::size_t>(t + taps.radius())], 1e-15) << "tap " << t;
  for (const auto& [t, tap] : sum) {
    if (std::abs(t) > taps.radius()) {
      EXPECT_EQ(tap, 0) << "tap " << t;
    }
  }
}

TEST(AxisTaps, AreOneRowWhereItMirrorsItself) {
  expect_taps({3}, 1);
  expect_taps({1, 2, 1}, 1);
  expect_taps({-1, 0, 1}, 1);
  expect_taps({0, -1, 1}, 1);
  expect_taps({-1, 1, 0}, 1);
  expect_taps({0, 0, 2, 2, 0}, 1);
  expect_taps({0, 0, 0}, 1);
}

TEST(AxisTaps, AreAnEvenAndAnOddRowElsewhere) {
  expect_taps({1, 2, 4}, 2);
  expect_taps({-1, 1, 1}, 2);
  expect_taps({2, 3, -2}, 2);  // odd but for the middle
  expect_taps({1, 2, 3, 2, 0.5}, 2);
}

// What the header of the taps promises: each row of a kernel, scaled or reversed, costs one; but slopes of a kernel
// that is cut, whose last tap has no mirror.
TEST(AxisTaps, AreOneRowForEveryRowOfAKernel) {
  for (double width : {2.0, 3.3, 6.0, 11.7})
    for (double spacing : {0.7, 1.0, 3.0})
      for (const auto& profile : {make_gaussian_profile(width), make_wendland_profile(width)}) {
        const KernelTaps taps = cell_averaged_taps(*profile, spacing);
        const bool is_cut = profile->value(profile->support()) != 0;
        for (const auto& [row, is_slope] :
             {std::pair{taps.value, false}, {taps.slope, true}, {taps.curvature, false}, {taps.slope_gram, true}}) {
          const std::size_t parts = is_cut && is_slope ? 2 : 1;
          expect_taps(row, parts);
          expect_taps(reversed(scaled(row, 0.37)), parts);
          EXPECT_EQ(AxisTaps<float>(scaled(row, 0.37)).parts().size(), parts);
        }
      }
}

}  // namespace
}  // namespace saltus
