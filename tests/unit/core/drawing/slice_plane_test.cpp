#include "core/drawing/slice_plane.h"

#include <gtest/gtest.h>

namespace saltus::drawing {
namespace {

VectorVolume<3> volume(const Index<3>& size, const Vector<3>& spacing) {
  ImageGrid<3> grid;
  grid.size = size;
  grid.spacing = spacing;
  return VectorVolume<3>(grid);
}

TEST(SlicePlane, HasSquarePixelsInMillimetres) {
  const auto planes = choose_planes(volume({40, 30, 10}, {1, 1, 5}));
  ASSERT_EQ(planes.size(), 3u);
  EXPECT_EQ(planes[0].width, 40);  // axial: x, y
  EXPECT_EQ(planes[0].height, 30);
  EXPECT_EQ(planes[1].width, 40);  // coronal: x, z
  EXPECT_EQ(planes[1].height, 50);
  EXPECT_EQ(planes[2].width, 30);  // sagittal: y, z
  EXPECT_EQ(planes[2].height, 50);
}

TEST(SlicePlane, GoesToThePictureAndBack) {
  VectorVolume<3> u = volume({40, 30, 10}, {1, 2, 5});
  u.grid.direction.diagonal() << -1, 1, -1;  // some pictures run against their grid axes, to the right and down
  for (const SlicePlane<3>& plane : choose_planes(u)) {
    const Vector<2> there = plane.picture_point(plane.index_at(3.25, 7.5, u.grid), u.grid);
    EXPECT_NEAR(there[0], 3.25, 1e-9) << plane.name;
    EXPECT_NEAR(there[1], 7.5, 1e-9) << plane.name;
  }
}

TEST(SlicePlane, PutsTheHeadUpAndThePatientsLeftOnTheRight) {
  const VectorVolume<3> u = volume({10, 10, 10}, {1, 1, 1});  // LPS: indices grow to the left, back and head
  const auto planes = choose_planes(u);
  const SlicePlane<3>& coronal = planes[1];
  EXPECT_EQ(coronal.name, "coronal");
  EXPECT_GT(coronal.index_at(0, 0, u.grid)[2], coronal.index_at(0, 9, u.grid)[2]);
  EXPECT_LT(coronal.index_at(0, 0, u.grid)[0], coronal.index_at(9, 0, u.grid)[0]);
}

TEST(SlicePlane, FollowsTheDirectionMatrix) {
  // Grid axes: x runs to the head, y to the right, z to the back. Oracle: by hand.
  VectorVolume<3> u = volume({10, 20, 30}, {1, 1, 1});
  u.grid.direction << 0, -1, 0, 0, 0, 1, 1, 0, 0;
  const auto planes = choose_planes(u);
  const SlicePlane<3>& axial = planes[0];
  EXPECT_EQ(axial.name, "axial");
  EXPECT_EQ(axial.right_axis, 1);
  EXPECT_EQ(axial.down_axis, 2);
  EXPECT_EQ(axial.slice_axis, 0);
  EXPECT_TRUE(axial.right_is_reversed);
  EXPECT_FALSE(axial.down_is_reversed);
  const SlicePlane<3>& sagittal = planes[2];
  EXPECT_EQ(sagittal.right_axis, 2);
  EXPECT_EQ(sagittal.down_axis, 0);
  EXPECT_TRUE(sagittal.down_is_reversed);
}

TEST(SlicePlane, CutsWhereTheMotionChanges) {
  VectorVolume<3> u = volume({30, 30, 30}, {1, 1, 1});
  // Jumps between x = 19 and 20, within a small block around y = 7, z = 22.
  for (int z = 20; z <= 24; ++z)
    for (int y = 5; y <= 9; ++y)
      for (int x = 20; x < 30; ++x) u.component(2)[x + 30 * (y + 30 * z)] = 10;
  for (const SlicePlane<3>& plane : choose_planes(u)) {
    EXPECT_EQ(plane.position[0], 19);
    EXPECT_NEAR(plane.position[1], 7, 3);
    EXPECT_NEAR(plane.position[2], 22, 3);
  }
}

TEST(SlicePlane, CutsTheMiddleWhenNothingMoves) {
  const auto planes = choose_planes(volume({11, 21, 31}, {1, 1, 1}));
  EXPECT_EQ(planes[0].position, Vector<3>(5, 10, 15));
}

}  // namespace
}  // namespace saltus::drawing
