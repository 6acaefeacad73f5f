#include "core/evaluation/label_overlap.h"

#include <gtest/gtest.h>

#include "core/support/errors.h"

namespace saltus {
namespace {

TEST(LabelOverlaps, AreDicePerLabel) {
  ImageGrid<2> grid;
  grid.size = {6, 1};
  Volume<2> a(grid), b(grid);
  a.samples = {0, 1, 1, 1, 2, 0};
  b.samples = {0, 0, 1, 1, 3, 3};
  const auto overlaps = label_overlaps(a, b);
  ASSERT_EQ(overlaps.size(), 3u);
  EXPECT_EQ(overlaps[0].label, 1);
  EXPECT_EQ(overlaps[0].voxels_a, 3u);
  EXPECT_EQ(overlaps[0].voxels_b, 2u);
  EXPECT_DOUBLE_EQ(overlaps[0].dice, 2.0 * 2 / 5);
  EXPECT_EQ(overlaps[1].label, 2);
  EXPECT_DOUBLE_EQ(overlaps[1].dice, 0);
  EXPECT_EQ(overlaps[2].label, 3);
}

TEST(LabelOverlaps, RefuseWhatCannotBeCompared) {
  ImageGrid<2> grid, other;
  grid.size = {6, 1};
  other.size = {5, 1};
  EXPECT_THROW(label_overlaps(Volume<2>(grid, 1), Volume<2>(other, 1)), InvalidInput);
  EXPECT_THROW(label_overlaps(Volume<2>(grid), Volume<2>(grid)), InvalidInput);
}

}  // namespace
}  // namespace saltus
