#include "core/evaluation/jacobian.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <limits>
#include <numeric>
#include <vector>

#include "tests/unit/core/evaluation/fields.h"

namespace saltus {
namespace {

// Oracle: det(I + A) of the affine map, which central and one-sided differences reproduce.
template <int Dim>
void expect_affine_determinant() {
  const Matrix<Dim> a = skewed_gradient<Dim>();
  const VectorVolume<Dim> field =
      make_field(oblique_grid<Dim>(), [&a](const Vector<Dim>& x) -> Vector<Dim> { return a * x; });
  const double expected = (Matrix<Dim>::Identity() + a).determinant();
  ASSERT_GT(std::abs(expected - 1), 0.05);
  for (float value : jacobian_determinant(field).samples) EXPECT_NEAR(value, expected, 1e-4);
}

TEST(Jacobian, OfAnAffineMapOnAnObliqueGrid2D) { expect_affine_determinant<2>(); }
TEST(Jacobian, OfAnAffineMapOnAnObliqueGrid3D) { expect_affine_determinant<3>(); }

TEST(Jacobian, OfASingleSliceIsThatOfThePlane) {
  ImageGrid<3> grid;
  grid.size = {5, 5, 1};
  const VectorVolume<3> field =
      make_field(grid, [](const Vector<3>& x) { return Vector<3>(0.5 * x[0], 0.1 * x[1], 3); });
  for (float value : jacobian_determinant(field).samples) EXPECT_NEAR(value, 1.5 * 1.1, 1e-5);
  EXPECT_EQ(jacobian_statistics(jacobian_determinant(field)).n, 9u);
}

TEST(JacobianStatistics, LeaveTheBorderOut) {
  ImageGrid<2> grid;
  grid.size = {4, 4};
  Volume<2> jacobian(grid, -7);
  jacobian.samples[5] = 1;
  jacobian.samples[6] = static_cast<float>(std::exp(2.0));
  jacobian.samples[9] = 0;
  jacobian.samples[10] = -1;
  const JacobianStatistics statistics = jacobian_statistics(jacobian);
  EXPECT_EQ(statistics.n, 4u);
  EXPECT_EQ(statistics.min, -1);
  EXPECT_NEAR(statistics.max, std::exp(2.0), 1e-6);
  EXPECT_EQ(statistics.share_not_positive, 0.5);
  EXPECT_NEAR(statistics.sd_log, 1, 1e-6);  // of {0, 2}
}

/// Of a volume whose inside is a little off 1.37 here and there, and whose border means nothing.
Volume<3> nearly_constant() {
  ImageGrid<3> grid;
  grid.size = {9, 8, 7};
  Volume<3> jacobian(grid, 1e-30f);
  for (int z = 1; z < 6; ++z)
    for (int y = 1; y < 7; ++y)
      for (int x = 1; x < 8; ++x)
        jacobian.samples[static_cast<std::size_t>((z * 8 + y) * 9 + x)] =
            1.37f + 1e-5f * static_cast<float>((3 * x + 5 * y + 7 * z) % 11);
  return jacobian;
}

TEST(JacobianStatistics, SeeSmallDeviationsOfAllPlanesTogether) {
  const Volume<3> jacobian = nearly_constant();
  std::vector<double> logarithms;
  for (float value : jacobian.samples)
    if (value > 1) logarithms.push_back(std::log(static_cast<double>(value)));
  ASSERT_EQ(logarithms.size(), 5u * 6 * 7);
  const double count = static_cast<double>(logarithms.size());
  const double mean = std::accumulate(logarithms.begin(), logarithms.end(), 0.0) / count;
  double squares = 0;
  for (double log : logarithms) squares += (log - mean) * (log - mean);
  const JacobianStatistics statistics = jacobian_statistics(jacobian);
  EXPECT_EQ(statistics.n, logarithms.size());
  EXPECT_EQ(statistics.share_not_positive, 0);
  EXPECT_NEAR(statistics.sd_log / std::sqrt(squares / count), 1, 1e-9);
}

TEST(JacobianStatistics, DoNotHideWhatIsNotFinite) {
  Volume<3> jacobian = nearly_constant();
  jacobian.samples[static_cast<std::size_t>((3 * 8 + 3) * 9 + 3)] = std::numeric_limits<float>::infinity();
  const JacobianStatistics statistics = jacobian_statistics(jacobian);
  EXPECT_TRUE(std::isinf(statistics.max));
  EXPECT_TRUE(std::isnan(statistics.sd_log));
}

}  // namespace
}  // namespace saltus
