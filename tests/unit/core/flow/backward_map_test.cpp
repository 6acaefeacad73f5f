#include "core/flow/backward_map.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "tests/support/finite_differences.h"
#include "tests/support/random_fields.h"

namespace saltus {
namespace {

using testing::dot;
using testing::random_field;
using testing::random_values;

const Lattice<2> kGrid{{41, 41}, {1, 1}, {-20, -20}}, kPoints{{9, 9}, {1.3, 1.3}, {-5.2, -5.2}};

/// Nodes of v(x, t), for velocities that are linear in x so that sampling them costs nothing.
template <class Velocity>
std::vector<Field<double>> nodes(int steps, Velocity&& velocity) {
  std::vector<Field<double>> all(static_cast<std::size_t>(steps) + 1, Field<double>(2 * kGrid.sites()));
  for (int k = 0; k <= steps; ++k)
    for (int slab = 0; slab < kGrid.size[1]; ++slab)
      visit_slab<2>(kGrid, slab, [&](const Index<2>& i, std::size_t site) {
        const Vector<2> v = velocity(Vector<2>(i[0] - 20.0, i[1] - 20.0), static_cast<double>(k) / steps);
        all[static_cast<std::size_t>(k)][2 * site] = v[0], all[static_cast<std::size_t>(k)][2 * site + 1] = v[1];
      });
  return all;
}

template <class Check>
void for_points(const Field<double>& map, Check&& check) {
  for (int slab = 0; slab < kPoints.size[1]; ++slab)
    visit_slab<2>(kPoints, slab, [&](const Index<2>& i, std::size_t site) {
      check(Vector<2>(i[0] * 1.3 - 5.2, i[1] * 1.3 - 5.2), Vector<2>(map[2 * site], map[2 * site + 1]));
    });
}

// Rotation about a centre that speeds up: angle(t) = a t + b t^2 / 2.
constexpr double kRate = 0.5, kGrowth = 0.9;
Vector<2> turning(const Vector<2>& x, double t) { return (kRate + kGrowth * t) * Vector<2>(-x[1] + 1, x[0] + 2); }
Vector<2> turned(const Vector<2>& x, double sense) {
  const Vector<2> centre(-2, 1);
  return centre + Eigen::Rotation2Dd(sense * (kRate + kGrowth / 2)) * (x - centre);
}

// Oracle: the rotation in closed form, as far out as 99.9 % of the sites lie. Within a disc, whose border does not
// turn: what leaves the lattice is not estimated.
TEST(MapError, IsHowFarTheStepsAreOff) {
  constexpr double kRadius = 18;
  const auto swirl = [](const Vector<2>& x) {
    return 0.8 * std::pow(std::cos(std::min(1.0, x.norm() / kRadius) * M_PI / 2), 2);  // angle
  };
  const Lattice<2> fine = {{161, 161}, {0.25, 0.25}, {-20, -20}};
  double before = 0;
  for (int steps : {1, 2, 4}) {
    Field<double> v(2 * fine.sites());
    const auto each_site = [&](auto&& visit) {
      for (int slab = 0; slab < fine.size[1]; ++slab)
        visit_slab<2>(fine, slab, [&](const Index<2>& i, std::size_t site) {
          visit(Vector<2>(0.25 * i[0] - 20, 0.25 * i[1] - 20), site);
        });
    };
    each_site([&](const Vector<2>& x, std::size_t site) {
      v[2 * site] = -swirl(x) * x[1];
      v[2 * site + 1] = swirl(x) * x[0];
    });
    const std::vector<Field<double>> velocities(static_cast<std::size_t>(steps) + 1, v);
    const Field<double> map = backward_map<2, double>(fine, fine, velocities);
    std::vector<double> off;
    each_site([&](const Vector<2>& x, std::size_t site) {
      const Vector<2> end = Eigen::Rotation2Dd(-swirl(x)) * x;
      off.push_back((x + Vector<2>(map[2 * site], map[2 * site + 1]) - end).norm());
    });
    std::sort(off.begin(), off.end());
    const double truth = off[static_cast<std::size_t>(0.999 * static_cast<double>(off.size() - 1))];
    const double estimate = map_error<2, double>(fine, velocities);
    EXPECT_NEAR(estimate / truth, 1, 0.2) << steps;
    if (before > 0) {
      EXPECT_NEAR(before / estimate, 4, 1.2) << steps;
    }
    before = estimate;
  }
  EXPECT_EQ((map_error<2, double>(fine, {Field<double>(2 * fine.sites()), Field<double>(2 * fine.sites())})), 0);
}

// Oracle: the rotation in closed form.
TEST(BackwardMap, ApproachesTheInverseFlowToSecondOrder) {
  std::vector<double> backward, forward;
  for (int steps : {4, 8, 16, 32}) {
    const auto v = nodes(steps, turning);
    double worst = 0;
    for_points(BackwardMap<2, double>(kPoints, kGrid, steps).follow(v), [&](const Vector<2>& x, const Vector<2>& u) {
      worst = std::max(worst, (x + u - turned(x, -1)).norm());
    });
    backward.push_back(worst);
    worst = 0;
    for_points(forward_map<2, double>(kPoints, kGrid, v),
               [&](const Vector<2>& x, const Vector<2>& u) { worst = std::max(worst, (x + u - turned(x, 1)).norm()); });
    forward.push_back(worst);
  }
  for (const auto* errors : {&backward, &forward})
    for (int k : {0, 1, 2}) EXPECT_NEAR(std::log2((*errors)[k] / (*errors)[k + 1]), 2, 0.35) << (*errors)[k];
}

// Oracle: psi(phi(x)) = x, for any number of steps: phi undoes what psi does, not what the flow does. Velocities change
// their axis in time, so that the steps do not commute.
TEST(BackwardMap, IsUndoneByTheForwardMapHoweverFewTheSteps) {
  const auto velocity = [](const Vector<2>& x, double t) {
    return Vector<2>(0.4 * x[0] - (1 - t) * x[1], 0.8 * t * x[0] - 0.4 * x[1] + std::sin(3 * t));
  };
  for (int steps : {2, 3, 8}) {
    const auto v = nodes(steps, velocity);
    // Both maps are affine, so psi is known everywhere from its values at three points.
    const Field<double> back = BackwardMap<2, double>(kPoints, kGrid, steps).follow(v);
    const auto at = [&](int x, int y) { return Vector<2>(back[2 * (9 * y + x)], back[2 * (9 * y + x) + 1]); };
    Matrix<2> slope;
    slope << (at(5, 4) - at(4, 4)) / 1.3, (at(4, 5) - at(4, 4)) / 1.3;
    for_points(forward_map<2, double>(kPoints, kGrid, v), [&](const Vector<2>& x, const Vector<2>& u) {
      const Vector<2> y = x + u;  // point (4, 4) is the origin
      // Each step is undone to 1e-4; later steps stretch what is left by less than exp(1).
      ASSERT_LT((y + at(4, 4) + slope * y - x).norm(), 3e-4 * steps) << steps;
    });
  }
}

// Oracle: a slip's shear layer, one sample thick, with 5 mm of motion across it: far from a contraction, yet undone.
TEST(BackwardMap, IsUndoneByTheForwardMapInAShearLayer) {
  const auto v = nodes(3, [](const Vector<2>& x, double) { return Vector<2>(x[1] > 0.5 ? 2.5 : -2.5, 0); });
  const Lattice<2> points{{9, 33}, {1, 0.25}, {-4, -4}};
  const Field<double> forward = forward_map<2, double>(points, kGrid, v);
  for (int slab = 0; slab < points.size[1]; ++slab)
    visit_slab<2>(points, slab, [&](const Index<2>& i, std::size_t site) {
      const double y = -4 + 0.25 * i[1], expected = 5 * std::clamp(y - 0.5, -0.5, 0.5);
      ASSERT_NEAR(forward[2 * site], expected, 1e-9) << y;
      ASSERT_EQ(forward[2 * site + 1], 0);
    });
}

// Oracle: point by point.
TEST(MoveForward, TakesWhatWasMovedToWherePointsGo) {
  const auto velocities =
      nodes(3, [](const Vector<2>& x, double t) { return Vector<2>(0.3 * x[1] + t, -0.2 * x[0] + 0.1 * x[1]); });
  Field<double> moved = random_field(2 * kPoints.sites(), 12);
  const Field<double> before = moved;
  move_forward<2, double>(kPoints, kGrid, velocities, moved);
  for (int slab = 0; slab < kPoints.size[1]; ++slab)
    visit_slab<2>(kPoints, slab, [&](const Index<2>& i, std::size_t site) {
      const Vector<2> rest(i[0] * 1.3 - 5.2, i[1] * 1.3 - 5.2);
      const Vector<2> expected =
          forward_guess<2, double>(kGrid, velocities, rest + Vector<2>(before[2 * site], before[2 * site + 1]));
      for (int c = 0; c < 2; ++c) EXPECT_NEAR(rest[c] + moved[2 * site + c], expected[c], 1e-12);
      EXPECT_GT((expected - rest).norm(), 0.01);
    });
}

TEST(BackwardMap, IsExactForASteadyTranslation) {
  const auto v = nodes(3, [](const Vector<2>&, double) { return Vector<2>(2.5, -1.25); });
  for_points(BackwardMap<2, double>(kPoints, kGrid, 3).follow(v),
             [](const Vector<2>&, const Vector<2>& u) { EXPECT_LT((u - Vector<2>(-2.5, 1.25)).norm(), 1e-12); });
}

// No map is interpolated: a jump of the velocity stays between the two rows where it is.
TEST(BackwardMap, KeepsASlipAsSharpAsTheVelocityHasIt) {
  const auto v = nodes(4, [](const Vector<2>& x, double) { return Vector<2>(x[1] > 0.5 ? 3.0 : -3.0, 0); });
  const Field<double> map = BackwardMap<2, double>(kGrid, kGrid, 4).follow(v);
  for (int slab = 0; slab < kGrid.size[1]; ++slab)
    visit_slab<2>(kGrid, slab, [&](const Index<2>& i, std::size_t site) {
      ASSERT_DOUBLE_EQ(map[2 * site], i[1] - 20 > 0.5 ? -3 : 3);
      ASSERT_EQ(map[2 * site + 1], 0);
    });
}

// Oracle: central differences of <dual, psi> in all velocities at once.
template <int Dim>
void expect_adjoint() {
  Lattice<Dim> grid, points;
  for (int axis = 0; axis < Dim; ++axis) {
    grid.size[axis] = 7 - axis, grid.spacing[axis] = 1.5, grid.offset[axis] = -0.4;
    points.size[axis] = 6, points.spacing[axis] = 1.3 + 0.1 * axis, points.offset[axis] = 0.1;
  }
  constexpr int steps = 3;
  const std::size_t each = Dim * grid.sites();
  const std::vector<double> v = random_values(each * (steps + 1), 1), along = random_values(v.size(), 2),
                            dual = random_values(Dim * points.sites(), 3);
  const auto split = [&](const std::vector<double>& all) {
    std::vector<Field<double>> fields;
    for (int k = 0; k <= steps; ++k) fields.emplace_back(all.begin() + k * each, all.begin() + (k + 1) * each);
    return fields;
  };
  BackwardMap<Dim, double> map(points, grid, steps);
  const double slope = testing::slope_along(
      [&](const std::vector<double>& at) { return dot(map.follow(split(at)), dual); }, v, along, 1e-7);
  std::vector<Field<double>> duals(steps + 1, Field<double>(each, 0.0));
  map.follow(split(v));
  Field<double> modified(dual.begin(), dual.end());
  map.adjoint(split(v), modified, duals);
  double found = 0;
  for (int k = 0; k <= steps; ++k) found += dot(duals[k], split(along)[k]);
  EXPECT_NEAR(found, slope, 1e-6 * std::sqrt(dot(dual, dual) * dot(along, along)));
  EXPECT_GT(std::abs(slope), 0.01);
}

TEST(BackwardMap, HasAnAdjoint) {
  expect_adjoint<2>();
  expect_adjoint<3>();
}

}  // namespace
}  // namespace saltus
