#include "core/flow/discontinuous/transport_points.h"

#include <gtest/gtest.h>

#include <Eigen/LU>

#include "core/flow/backward_map.h"
#include "core/flow/geodesic_shooting.h"
#include "core/grid/interpolation.h"
#include "core/support/errors.h"

#ifdef _OPENMP
#include <omp.h>

#include "tests/support/many_threads.h"
#endif

namespace saltus {
namespace {

/// A slip of `slip` mm along x across the face above row 23, and a uniform rise of `rise` mm.
struct Scene {
  MomentumScale<2, double> scale;
  std::vector<double> zeroth, first;
  GeodesicShooting<2, double> shooting;
  std::unique_ptr<GriddedVelocity<2, double>> velocity;
  double unit;

  Scene(double slip, double rise)
      : scale({make_wendland_profile(9), {{48, 48}, {1, 1}, {0, 0}}, Orders::ZerothAndFirst, 1.0, 1.0}),
        zeroth(scale.field_size()),
        first(2 * scale.field_size()),
        shooting({&scale}, scale.lattice(), 4, Evolution::Carried) {
    const KernelProfile& k0 = *scale.options().kernel.components().front().profile;
    unit = slip / (2 * (k0.value(1) - k0.value(0)));
    for (std::size_t site = 0; site < scale.lattice().sites(); ++site) zeroth[2 * site + 1] = rise;
    for (int x = 0; x < 48; ++x) first[scale.field_size() + 2 * (23 * 48 + x)] = unit * k0.mass() / k0.width();
    shooting.shoot({{zeroth.data(), first.data()}});
    velocity = std::make_unique<GriddedVelocity<2, double>>(
        scale.lattice(), shooting.velocities(),
        find_switching_sheets<2, double>(scale, first.data(), scale.lattice(), shooting.velocities()));
  }

  std::vector<TransportedPoint<2>> move(const std::vector<Vector<2>>& points, TransportDirection direction) const {
    return transport_points<2, double>(*velocity, points, direction, gridded_trajectory_options(scale.lattice()));
  }

  /// Velocity along x of a flow without rise: k0(y - face below) - k0(y - face above), on its own side in a straight
  /// line up to the face (k0 is a parabola there).
  double slip_velocity(double y) const {
    const KernelProfile& k0 = *scale.options().kernel.components().front().profile;
    const double side = y > 23.5 ? 1 : -1, from = std::abs(y - 23.5);
    const auto sample = [&](int i) { return k0.value(i + 1) - k0.value(i); };
    return side * unit * (sample(0) + (from - 0.5) * (sample(1) - sample(0)));
  }
};

TEST(TransportPoints, IsSharpAtTheInterfaceWhereInterpolationIsNot) {
  const Scene scene(4, 0);
  std::vector<Vector<2>> points;
  for (double y : {23.5 - 5.2, 23.5 - 1.7, 23.4, 23.49, 23.51, 23.6, 23.5 + 1.7, 23.5 + 5.2})
    points.emplace_back(24, y);
  const auto found = scene.move(points, TransportDirection::FixedToMoving);
  BackwardMap<2, double> map(scene.scale.lattice(), scene.scale.lattice(), 4);
  const Field<double> field = map.follow(scene.shooting.velocities());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double y = points[i][1], moved = found[i].position[0] - points[i][0];
    EXPECT_EQ(found[i].ending, TrajectoryEnd::Complete);
    EXPECT_NEAR(found[i].position[1], y, 1e-6);
    EXPECT_NEAR(moved, -scene.slip_velocity(y), 2e-3) << y;
    EXPECT_NEAR(found[i].fundamental.determinant(), 1, 1e-3) << "one-sided: a shear keeps volumes";
    const LinearCell<2, double> cell(scene.scale.lattice(), {points[i][0], y});
    const double interpolated = cell.value<2>(field.data())[0];
    if (std::abs(y - 23.5) > 0.5)
      EXPECT_NEAR(moved, interpolated, 0.02) << y;
    else
      EXPECT_GT(std::abs(moved - interpolated), 1.5) << "linear interpolation mixes both sides at " << y;
  }
}

TEST(TransportPoints, KeepsPointsOnTheirSideOfASheetThatMovesAcrossSamples) {
  const Scene still(4, 0), rising(4, 2.3);
  for (double y : {23.2, 23.45, 23.55, 23.8}) {
    const auto moved = rising.move({Vector<2>(24, y)}, TransportDirection::MovingToFixed)[0];
    EXPECT_EQ(moved.ending, TrajectoryEnd::Complete);
    EXPECT_EQ(moved.crossed, 0);
    EXPECT_NEAR(moved.position[1], y + 2.3, 0.03);
    // What the push spreads over two faces costs little; a mixture of both sides would cost half of the slip.
    EXPECT_NEAR(moved.position[0] - 24, still.slip_velocity(y), 0.25) << y;
    const auto back = rising.move({moved.position}, TransportDirection::FixedToMoving)[0];
    EXPECT_LT((back.position - Vector<2>(24, y)).norm(), 5e-3);
    EXPECT_LT((back.fundamental * moved.fundamental - Matrix<2>::Identity()).norm(), 0.05);
  }
}

TEST(TransportPoints, DoesNotDependOnTheNumberOfThreads) {
#ifdef _OPENMP
  const Scene scene(4, 1.3);
  std::vector<Vector<2>> points;
  for (int i = 0; i < 60; ++i) points.emplace_back(10 + 0.45 * i, 21 + 0.083 * i);
  const testing::ManyThreads many;
  omp_set_num_threads(1);
  const auto one = scene.move(points, TransportDirection::FixedToMoving);
  omp_set_num_threads(2);
  const auto two = scene.move(points, TransportDirection::FixedToMoving);
  for (std::size_t i = 0; i < points.size(); ++i) {
    EXPECT_EQ(one[i].position, two[i].position);
    EXPECT_EQ(one[i].fundamental, two[i].fundamental);
  }
#else
  GTEST_SKIP() << "built without OpenMP";
#endif
}

TEST(TransportPoints, RefusesPointsThatAreNotFinite) {
  const Scene scene(4, 0);
  EXPECT_THROW(scene.move({Vector<2>(0, std::nan(""))}, TransportDirection::FixedToMoving), InvalidInput);
}

}  // namespace
}  // namespace saltus
