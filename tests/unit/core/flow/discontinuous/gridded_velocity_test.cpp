#include "core/flow/discontinuous/gridded_velocity.h"

#include <gtest/gtest.h>

#include "core/flow/geodesic_shooting.h"
#include "tests/support/random_fields.h"

namespace saltus {
namespace {

/// Linear in space, of one side (+1, -1), at time node k.
template <int Dim>
Vector<Dim> side_velocity(int side, int node, const Vector<Dim>& x) {
  Vector<Dim> v;
  for (int c = 0; c < Dim; ++c) {
    v[c] = side * (1 + 0.3 * c) + 0.2 * node;
    for (int a = 0; a < Dim; ++a) v[c] += 0.05 * std::sin(1 + c + 2 * a + side + node) * x[a];
  }
  return v;
}

/// A flat sheet at `heights` (samples along `axis`, one a node), and a velocity that is linear on either side; what is
/// not clean holds nonsense.
template <int Dim>
struct TwoSides {
  Lattice<Dim> lattice;
  std::vector<Field<double>> velocities;
  std::vector<SwitchingSheet<Dim>> sheets{1};

  TwoSides(const Lattice<Dim>& where, int axis, const std::vector<double>& heights) : lattice(where) {
    SwitchingSheet<Dim>& sheet = sheets[0];
    sheet.axis = axis;
    sheet.lattice = where;
    sheet.size = where.size;
    sheet.size[axis] = 1;
    for (std::size_t k = 0; k < heights.size(); ++k) {
      const double mm = heights[k] * where.spacing[axis] + where.offset[axis];
      sheet.nodes.emplace_back(where.sites() / where.size[axis],
                               typename SwitchingSheet<Dim>::Column{static_cast<float>(mm), 1.0f, true});
      Field<double> v(Dim * where.sites());
      for (int slab = 0; slab < where.size[Dim - 1]; ++slab)
        visit_slab<Dim>(where, slab, [&](const Index<Dim>& index, std::size_t site) {
          Vector<Dim> x;
          for (int a = 0; a < Dim; ++a) x[a] = index[a] * where.spacing[a] + where.offset[a];
          const double off = index[axis] - heights[k];
          const Vector<Dim> value = std::abs(off) < kCleanDistance
                                        ? Vector<Dim>(Vector<Dim>::Constant(1e3))
                                        : side_velocity<Dim>(off > 0 ? 1 : -1, static_cast<int>(k), x);
          for (int c = 0; c < Dim; ++c) v[Dim * site + c] = value[c];
        });
      velocities.push_back(std::move(v));
    }
  }
};

template <int Dim>
void check_sides(const Lattice<Dim>& lattice, int axis) {
  // On a face, inside a cell, and past three samples within a step.
  const TwoSides<Dim> scene(lattice, axis, {7.5, 7.8, 11.1});
  const GriddedVelocity<Dim, double> velocity(scene.lattice, scene.velocities, scene.sheets);
  testing::Random random(3);
  for (int trial = 0; trial < 200; ++trial) {
    Vector<Dim> x;
    for (int a = 0; a < Dim; ++a)
      x[a] = lattice.offset[a] + lattice.spacing[a] * (0.5 * (lattice.size[a] - 1) * (1 + 0.95 * random.symmetric()));
    const double t = 0.5 + 0.5 * random.symmetric();
    const SurfaceJet<Dim> jet = velocity.surface(0, t, x);
    ASSERT_TRUE(jet.exists);
    const int node = t < 0.5 ? 0 : 1;
    const double share = 2 * t - node;
    const auto expected = [&](int side, const Vector<Dim>& at) -> Vector<Dim> {
      return (1 - share) * side_velocity<Dim>(side, node, at) + share * side_velocity<Dim>(side, node + 1, at);
    };
    for (int side : {-1, 1}) {
      if (side * jet.value < -0.5 * lattice.spacing[axis]) continue;  // no side is asked for far beyond its sheet
      const VelocityJet<Dim> found = velocity.velocity(t, x, {static_cast<signed char>(side)});
      EXPECT_LT((found.value - expected(side, x)).norm(), 1e-6) << "side " << side << " t " << t;
      for (int a = 0; a < Dim; ++a)
        EXPECT_LT((found.jacobian.col(a) - (expected(side, x + Vector<Dim>::Unit(a)) - expected(side, x))).norm(),
                  1e-5);
    }
  }
}

// Oracle: linear fields, which interpolation and extrapolation reproduce.
TEST(GriddedVelocity, SeesOnlyTheSamplesOfItsSideIn2D) {
  check_sides<2>({{20, 18}, {1, 0.5}, {0.3, -2}}, 1);
  check_sides<2>({{20, 18}, {1.5, 0.5}, {0.3, -2}}, 0);
}
TEST(GriddedVelocity, SeesOnlyTheSamplesOfItsSideIn3D) { check_sides<3>({{9, 18, 10}, {1, 2, 0.5}, {0, 1, 0}}, 1); }

/// A sheet of first-order momentum on the faces above row 23 that makes a slip along x, and a uniform rise.
struct SlipAndRise {
  MomentumScale<2, double> scale;
  std::vector<double> zeroth, first;
  GeodesicShooting<2, double> shooting;
  double taps_factor;  ///< sigma / mass

  SlipAndRise(double slip, double rise)
      : scale({make_wendland_profile(9), {{48, 48}, {1, 1}, {0, 0}}, Orders::ZerothAndFirst, 1.0, 1.0}),
        zeroth(scale.field_size()),
        first(2 * scale.field_size()),
        shooting({&scale}, scale.lattice(), 4, Evolution::Carried) {
    const KernelProfile& k0 = *scale.options().kernel.components().front().profile;
    taps_factor = k0.width() / k0.mass();
    for (std::size_t site = 0; site < scale.lattice().sites(); ++site) zeroth[2 * site + 1] = rise;
    for (int x = 0; x < 48; ++x) {
      const std::size_t site = 23 * 48 + x;
      first[scale.field_size() + 2 * site] = slip / (taps_factor * 2 * (k0.value(1) - k0.value(0)));
    }
    shooting.shoot({{zeroth.data(), first.data()}});
  }

  std::vector<SwitchingSheet<2>> sheets() {
    return find_switching_sheets<2, double>(scale, first.data(), scale.lattice(), shooting.velocities());
  }
};

TEST(SwitchingSheet, IsFoundWhereTheMomentumJumpsAndMovesWithTheFlow) {
  for (double rise : {0.0, 2.3}) {
    SlipAndRise scene(3, rise);
    const auto sheets = scene.sheets();
    ASSERT_EQ(sheets.size(), 1u);
    EXPECT_EQ(sheets[0].axis, 1);
    for (int node = 0; node <= 4; ++node) {
      const auto* column = sheets[0].column(node, {24, 0});
      ASSERT_NE(column, nullptr);
      EXPECT_NEAR(column->height, 23.5 + rise * node / 4, 0.02) << node;
    }
    const GriddedVelocity<2, double> velocity(scene.scale.lattice(), scene.shooting.velocities(), sheets);
    const Vector<2> on(24, 23.5);
    const SurfaceJet<2> jet = velocity.surface(0, 0.0, on);
    EXPECT_NEAR(jet.value, 0, 1e-6);
    EXPECT_NEAR(jet.rate, -rise, 0.05);
    const Vector<2> jump = velocity.velocity(0, on, {1}).value - velocity.velocity(0, on, {-1}).value;
    // Samples of the slip lie on a straight line on either side, k0 being a parabola there.
    const KernelProfile& k0 = *scene.scale.options().kernel.components().front().profile;
    const double s1 = (k0.value(1) - k0.value(0)), s2 = (k0.value(2) - k0.value(1));
    EXPECT_NEAR(jump[0], 3 * (1.5 * s1 - 0.5 * s2) / s1, 1e-3);
    EXPECT_NEAR(jump[1], 0, 1e-6);
  }
}

TEST(SwitchingSheet, IsNotFoundWhereNothingJumps) {
  SlipAndRise weak(0.01, 0);
  EXPECT_TRUE(weak.sheets().empty()) << "below least_jump_samples";
  SlipAndRise scene(3, 0);
  const Lattice<2> finer{{95, 95}, {0.5, 0.5}, {0, 0}};
  const std::vector<Field<double>> still(2, Field<double>(2 * finer.sites(), 0.0));
  EXPECT_TRUE((find_switching_sheets<2, double>(scene.scale, scene.first.data(), finer, still).empty()))
      << "a coarser scale makes a ramp";
  MomentumScale<2, double> smooth({make_gaussian_profile(9), scene.scale.lattice(), Orders::First, 1.0, 1.0});
  EXPECT_TRUE(
      (find_switching_sheets<2, double>(smooth, scene.first.data(), smooth.lattice(), scene.shooting.velocities())
           .empty()));
}

}  // namespace
}  // namespace saltus
