// Figures of a slip surface. Oracle: sums by hand.
#include "core/slip/slip_surface.h"

#include <gtest/gtest.h>

namespace saltus {
namespace {

SlipPoint<2> piece(double area, double jump, double gap, int part = 0) {
  SlipPoint<2> point;
  point.normal = Vector<2>::Unit(1);
  point.area = area;
  point.jump = jump * Vector<2>::Unit(0);
  point.gap_mm = gap;
  point.part = part;
  return point;
}

TEST(SlipSummary, CountsEveryPieceWithItsArea) {
  // The last twentieth of the area, and of it only, lies above each quantile.
  const SlipSurface<2> surface{{piece(1, 8, 0.4), piece(15, 2, -0.1), piece(4, -3, -0.6, 1)}, 0.1};
  const SlipSummary found = summarise(surface);
  EXPECT_DOUBLE_EQ(found.area, 20);
  EXPECT_EQ(found.parts, 2);
  EXPECT_DOUBLE_EQ(found.jump_mean_mm, (8 + 15 * 2 + 4 * 3) / 20.0);
  EXPECT_DOUBLE_EQ(found.jump_p95_mm, 3);
  EXPECT_DOUBLE_EQ(found.jump_max_mm, 8);
  EXPECT_DOUBLE_EQ(found.gap_p95_mm, 0);
  EXPECT_DOUBLE_EQ(found.overlap_p95_mm, 0.6);
}

TEST(SlipSummary, IsZeroOfNothing) {
  const SlipSummary found = summarise(SlipSurface<3>{});
  EXPECT_EQ(found.area, 0);
  EXPECT_EQ(found.parts, 0);
  EXPECT_EQ(found.jump_mean_mm, 0);
  EXPECT_EQ(found.jump_p95_mm, 0);
}

}  // namespace
}  // namespace saltus
