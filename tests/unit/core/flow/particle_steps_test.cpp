#include "core/flow/particle_steps.h"

#include <gtest/gtest.h>

#include "tests/support/finite_differences.h"
#include "tests/support/random_fields.h"

namespace saltus {
namespace {

using testing::dot;
using testing::random_values;

template <int Dim>
Lattice<Dim> points() {
  if constexpr (Dim == 2)
    return {{9, 7}, {1, 1.5}, {0.2, 0.1}};
  else
    return {{6, 5, 4}, {1, 1.5, 2}, {0.2, 0.1, 0}};
}

template <int Dim>
Lattice<Dim> nodes() {
  if constexpr (Dim == 2)
    return {{7, 8}, {1.4, 1.3}, {}};
  else
    return {{5, 6, 5}, {1.3, 1.3, 1.6}, {}};
}

// Oracle: a velocity that is linear in space is its own interpolant.
TEST(Advance, AddsTheVelocityAtThePlaceOfThePoint) {
  const Lattice<2> where = points<2>(), grid = nodes<2>();
  std::vector<double> v(2 * grid.sites());
  const auto velocity = [](double x, double y) { return std::array{0.3 * x - 0.2 * y + 1, 0.1 * x + 0.4 * y}; };
  for (int slab = 0; slab < grid.size[1]; ++slab)
    visit_slab<2>(grid, slab, [&](const Index<2>& i, std::size_t site) {
      const auto value = velocity(i[0] * 1.4, i[1] * 1.3);
      v[2 * site] = value[0], v[2 * site + 1] = value[1];
    });
  const std::vector<double> a = random_values(2 * where.sites(), 1), at = random_values(2 * where.sites(), 2, 0.4);
  std::vector<double> out(2 * where.sites()), bare(2 * where.sites());
  advance<2, double>(where, a.data(), at.data(), grid, v.data(), -0.5, out.data());
  advance<2, double>(where, nullptr, nullptr, grid, v.data(), 2.0, bare.data());
  int inner = 0;
  for (int slab = 1; slab < where.size[1] - 1; ++slab)
    visit_slab<2>(where, slab, [&](const Index<2>& i, std::size_t site) {
      if (i[0] == 0 || i[0] > 6 || i[1] > 4) return;
      ++inner;
      const double x = i[0] * 1.0 + 0.2, y = i[1] * 1.5 + 0.1;
      const auto moved = velocity(x + at[2 * site], y + at[2 * site + 1]), still = velocity(x, y);
      for (int c : {0, 1}) {
        ASSERT_NEAR(out[2 * site + c], a[2 * site + c] - 0.5 * moved[c], 1e-12);
        ASSERT_NEAR(bare[2 * site + c], 2 * still[c], 1e-12);
      }
    });
  EXPECT_GT(inner, 15);
}

// Oracle: <advance(v + e w, at + e b), dual> by central differences; exact in v, because it is linear there.
template <int Dim>
void expect_adjoint() {
  const Lattice<Dim> where = points<Dim>(), grid = nodes<Dim>();
  const std::vector<double> at = random_values(Dim * where.sites(), 1, 0.7), v = random_values(Dim * grid.sites(), 2),
                            dual = random_values(Dim * where.sites(), 3), at_along = random_values(at.size(), 4),
                            v_along = random_values(v.size(), 5);
  const auto pairing = [&](const std::vector<double>& place, const std::vector<double>& velocity) {
    std::vector<double> out(Dim * where.sites());
    advance<Dim, double>(where, nullptr, place.data(), grid, velocity.data(), 0.6, out.data());
    return dot(out, dual);
  };
  std::vector<double> v_dual(v.size(), 0.0), at_dual(at.size(), 0.0), only_v(v.size(), 0.0);
  advance_adjoint<Dim, double>(where, at.data(), grid, v.data(), 0.6, dual.data(), v_dual.data(), at_dual.data());
  EXPECT_NEAR(dot(v_dual, v), pairing(at, v), 1e-12 * std::sqrt(dot(v, v) * dot(dual, dual)));
  EXPECT_NEAR(dot(v_dual, v_along), pairing(at, v_along), 1e-12 * std::sqrt(dot(v, v) * dot(dual, dual)));
  const double slope = testing::slope_along([&](const auto& place) { return pairing(place, v); }, at, at_along, 1e-7);
  EXPECT_NEAR(dot(at_dual, at_along), slope, 1e-6 * std::sqrt(dot(at_dual, at_dual) * dot(at_along, at_along)));
  advance_adjoint<Dim, double>(where, at.data(), grid, v.data(), 0.6, dual.data(), only_v.data(), nullptr);
  EXPECT_EQ(only_v, v_dual);
}

TEST(Advance, HasAnAdjoint) {
  expect_adjoint<2>();
  expect_adjoint<3>();
}

// Oracle: the same two velocities sampled one after the other.
TEST(AdvanceHeun, IsTwoSamplesOneAfterTheOther) {
  const Lattice<3> grid = {{7, 6, 5}, {1, 1.5, 0.8}, {0.3, 0, -0.2}}, other = {{6, 5, 4}, {1.1, 1.6, 0.9}, {}};
  const std::vector<double> first = random_values(3 * grid.sites(), 1), second = random_values(3 * grid.sites(), 2);
  const double step = -0.7;
  for (const Lattice<3>& points : {grid, other})
    for (bool at_rest : {false, true}) {
      const std::vector<double> d = random_values(3 * points.sites(), 3);
      const double* from = at_rest ? nullptr : d.data();
      std::vector<double> predicted(d.size()), expected(d.size()), found(d.size());
      // Points at rest at the samples themselves are told by a displacement of 0 here, by null there.
      const std::vector<double> rest(d.size(), 0.0);
      const double* at = at_rest ? rest.data() : d.data();
      advance<3, double>(points, from, at, grid, first.data(), step, predicted.data());
      advance<3, double>(points, from, at, grid, first.data(), step / 2, expected.data());
      advance<3, double>(points, expected.data(), predicted.data(), grid, second.data(), step / 2, expected.data());
      advance_heun<3, double>(points, from, grid, first.data(), second.data(), step, found.data());
      for (std::size_t i = 0; i < d.size(); ++i) ASSERT_NEAR(found[i], expected[i], 1e-14) << i;
    }
}

// Oracle: the general way, which a displacement of 0 takes.
TEST(Advance, AtTheSamplesIsWhatADisplacementOfZeroGives) {
  const Lattice<2> grid = {{6, 5}, {1, 1.5}, {0.3, 0}};
  const std::vector<double> v = random_values(2 * grid.sites(), 1), a = random_values(v.size(), 2),
                            dual = random_values(v.size(), 3), rest(v.size(), 0.0);
  std::vector<double> expected(v.size()), found(v.size()), expected_dual(v.size(), 0.0), found_dual(v.size(), 0.0);
  advance<2, double>(grid, a.data(), rest.data(), grid, v.data(), 0.6, expected.data());
  advance<2, double>(grid, a.data(), nullptr, grid, v.data(), 0.6, found.data());
  advance_adjoint<2, double>(grid, rest.data(), grid, v.data(), 0.6, dual.data(), expected_dual.data(), nullptr);
  advance_adjoint<2, double>(grid, nullptr, grid, v.data(), 0.6, dual.data(), found_dual.data(), nullptr);
  for (std::size_t i = 0; i < v.size(); ++i) {
    ASSERT_NEAR(found[i], expected[i], 1e-14) << i;
    ASSERT_NEAR(found_dual[i], expected_dual[i], 1e-14) << i;
  }
}

}  // namespace
}  // namespace saltus
