#include "server/worker/report/interface.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

namespace saltus::report {
namespace {

/// A displacement given by a function of the world position.
template <int Dim, class Motion>
VectorVolume<Dim> field(const Index<Dim>& size, const Vector<Dim>& spacing, const Motion& motion) {
  ImageGrid<Dim> grid;
  grid.size = size;
  grid.spacing = spacing;
  VectorVolume<Dim> u(grid);
  for (std::size_t voxel = 0; voxel < grid.voxels(); ++voxel) {
    Vector<Dim> index;
    std::size_t rest = voxel;
    for (int axis = 0; axis < Dim; ++axis) {
      index[axis] = static_cast<double>(rest % static_cast<std::size_t>(size[axis]));
      rest /= static_cast<std::size_t>(size[axis]);
    }
    const Vector<Dim> value = motion(grid.to_world(index));
    for (int c = 0; c < Dim; ++c) u.component(c)[voxel] = static_cast<float>(value[c]);
  }
  return u;
}

TEST(Interface, FindsAPlaneWithItsSlipAndItsArea) {
  // y < 14.5 (between the voxels at 14 and 15) moves by +3 along z, the rest by -3.
  const auto u =
      field<3>({10, 30, 20}, {2, 1, 1.5}, [](const Vector<3>& x) { return Vector<3>(0, 0, x[1] < 14.5 ? 3 : -3); });
  const auto found = detect_interface(u);
  ASSERT_EQ(found.faces.size(), 200u);
  for (const auto& face : found.faces) {
    EXPECT_EQ(face.axis, 1);
    EXPECT_EQ(face.voxel[1], 14);
    EXPECT_NEAR(face.slip_mm, 6, 1e-5);
    EXPECT_NEAR(face.opening_mm, 0, 1e-5);
  }
  EXPECT_NEAR(found.extent, 200 * 2 * 1.5, 1e-6);
  ASSERT_TRUE(found.strongest);
  EXPECT_EQ((*found.strongest)[1], 14.5);
}

TEST(Interface, SeesTheWholeJumpOverAVoxelThatIsAMixture) {
  const auto u = field<2>({20, 30}, {1, 1}, [](const Vector<2>& x) {
    return Vector<2>(x[1] < 14 ? 4 : x[1] > 14 ? -4 : 1, 0);
  });
  const auto found = detect_interface(u);
  ASSERT_EQ(found.faces.size(), 20u);
  for (const auto& face : found.faces) EXPECT_NEAR(face.slip_mm, 8, 1e-5);
}

TEST(Interface, SubtractsTheSlopesOfTheTwoSides) {
  // Both sides move with a slope of their own; at y = 14.5 the left limit is 2.9 and the right one -1.45.
  const auto u = field<2>({20, 30}, {1, 1},
                          [](const Vector<2>& x) { return Vector<2>(x[1] < 14.5 ? 0.2 * x[1] : -0.1 * x[1], 0); });
  const auto found = detect_interface(u);
  ASSERT_EQ(found.faces.size(), 20u);
  for (const auto& face : found.faces) EXPECT_NEAR(face.slip_mm, 2.9 + 1.45, 1e-4);
}

TEST(Interface, TakesTheStepsOfAnObliqueLineAsOneSlope) {
  const double angle = 30 * std::numbers::pi / 180;
  const Vector<2> along(std::cos(angle), std::sin(angle)), across(-along[1], along[0]);
  const auto u = field<2>({80, 80}, {1, 1}, [&](const Vector<2>& x) {
    return Vector<2>((across.dot(x - Vector<2>(39.5, 39.5)) > 0.1 ? 3.0 : -3.0) * along);
  });
  const auto found = detect_interface(u);
  EXPECT_NEAR(found.slip_mm.median, 6, 0.3);
  EXPECT_LT(found.gap_mm.median, 1.2);
  EXPECT_NEAR(found.extent, 75 / std::cos(angle), 6);  // border excluded
}

TEST(Interface, TellsOpeningFromSlip) {
  // 4 along the interface, 1.5 away from it.
  const auto u =
      field<2>({20, 30}, {1, 1}, [](const Vector<2>& x) { return x[1] < 14.5 ? Vector<2>(2, 0) : Vector<2>(-2, 1.5); });
  const auto found = detect_interface(u);
  ASSERT_EQ(found.faces.size(), 20u);
  for (const auto& face : found.faces) {
    EXPECT_NEAR(face.slip_mm, 4, 1e-5);
    EXPECT_NEAR(face.opening_mm, 1.5, 1e-5);
  }
}

TEST(Interface, LeavesOutFacesThatJumpEachInTheirOwnWay) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> any(-3, 3);
  const auto u = field<3>({20, 20, 20}, {1, 1, 1}, [&](const Vector<3>& x) {
    return Vector<3>(any(random), any(random), (x[1] < 9.5 ? 20 : -20) + any(random));
  });
  const auto found = detect_interface(u);
  std::size_t elsewhere = 0;
  for (const auto& face : found.faces) elsewhere += face.axis != 1 || face.voxel[1] != 9;
  EXPECT_GT(found.faces.size() - elsewhere, 350u);  // of 400
  EXPECT_LT(elsewhere, found.faces.size() / 50);
}

TEST(Interface, FindsNoneInASmoothMotion) {
  const auto bump = field<3>({30, 30, 30}, {1, 1, 3}, [](const Vector<3>& x) {
    const Vector<3> off = (x - Vector<3>(15, 15, 45)).cwiseQuotient(Vector<3>(5, 5, 8));
    return Vector<3>(0, 0, 12 * std::exp(-off.squaredNorm() / 2));
  });
  EXPECT_TRUE(detect_interface(bump).faces.empty());
  const auto still = field<2>({20, 20}, {1, 1}, [](const Vector<2>&) { return Vector<2>(0, 0); });
  EXPECT_TRUE(detect_interface(still).faces.empty());
  EXPECT_FALSE(detect_interface(still).strongest);
}

}  // namespace
}  // namespace saltus::report
