#include "core/flow/particle_steps.h"

#include <gtest/gtest.h>
#include <omp.h>

#include <cmath>
#include <cstring>

#include "tests/support/finite_differences.h"
#include "tests/support/many_threads.h"
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

template <int Dim>
struct HeunScene {
  Lattice<Dim> points, grid;
  std::vector<double> d, first, second, dual;
  double step = -0.7;

  HeunScene(const Lattice<Dim>& of_points, const Lattice<Dim>& of_grid)
      : points(of_points),
        grid(of_grid),
        d(random_values(Dim * points.sites(), 1, 0.6)),
        first(random_values(Dim * grid.sites(), 2)),
        second(random_values(Dim * grid.sites(), 3)),
        dual(random_values(Dim * points.sites(), 4)) {}

  double pairing(const double* from, const std::vector<double>& one, const std::vector<double>& other) const {
    std::vector<double> out(d.size());
    advance_heun<Dim, double>(points, from, grid, one.data(), other.data(), step, out.data());
    return dot(out, dual);
  }
};

// Oracles: central differences along random directions of both velocities and of where points come from; what is
// already in a dual of a velocity stays.
template <int Dim>
void expect_adjoint_of_heun(const Lattice<Dim>& points, const Lattice<Dim>& grid, bool at_rest) {
  const HeunScene<Dim> s(points, grid);
  const double* from = at_rest ? nullptr : s.d.data();
  const std::vector<double> before = random_values(s.first.size(), 9);
  std::vector<double> first_dual = before, second_dual = before, d_dual(s.d.size(), 7.0);
  advance_heun_adjoint<Dim, double>(s.points, from, s.grid, s.first.data(), s.second.data(), s.step, s.dual.data(),
                                    first_dual.data(), second_dual.data(), d_dual.data());
  for (std::size_t i = 0; i < before.size(); ++i) first_dual[i] -= before[i], second_dual[i] -= before[i];
  const std::vector<double> along_v = random_values(s.first.size(), 5), along_d = random_values(s.d.size(), 6);
  const auto expect_slope = [](const std::vector<double>& found, const std::vector<double>& along, double slope) {
    EXPECT_NEAR(dot(found, along), slope, 1e-6 * std::sqrt(dot(found, found) * dot(along, along)));
  };
  expect_slope(
      first_dual, along_v,
      testing::slope_along([&](const auto& v) { return s.pairing(from, v, s.second); }, s.first, along_v, 1e-7));
  expect_slope(
      second_dual, along_v,
      testing::slope_along([&](const auto& v) { return s.pairing(from, s.first, v); }, s.second, along_v, 1e-7));
  if (!at_rest)
    expect_slope(d_dual, along_d,
                 testing::slope_along([&](const auto& d) { return s.pairing(d.data(), s.first, s.second); }, s.d,
                                      along_d, 1e-7));
}

TEST(AdvanceHeun, HasAnAdjoint) {
  for (const bool at_rest : {false, true}) {
    expect_adjoint_of_heun<2>(points<2>(), nodes<2>(), at_rest);
    expect_adjoint_of_heun<2>(points<2>(), points<2>(), at_rest);
    expect_adjoint_of_heun<3>(points<3>(), nodes<3>(), at_rest);
    expect_adjoint_of_heun<3>(points<3>(), points<3>(), at_rest);
    const Lattice<3> thin = {{1, 6, 7}, {1, 1, 1.2}, {}}, flat = {{19, 1, 6}, {1, 1, 1.2}, {}};
    expect_adjoint_of_heun<3>(points<3>(), thin, at_rest);
    expect_adjoint_of_heun<3>(flat, flat, at_rest);
  }
}

template <class T>
std::vector<T> in(const std::vector<double>& values) {
  return {values.begin(), values.end()};
}

/// The duals of both velocities, which begin with 0, and of where points come from.
template <class T>
std::vector<T> duals_of_heun(const HeunScene<3>& s, bool at_rest, int threads) {
  omp_set_num_threads(threads);
  std::vector<T> all(2 * s.first.size() + s.d.size(), T(0));
  T* to = all.data();
  advance_heun_adjoint<3, T>(s.points, at_rest ? nullptr : in<T>(s.d).data(), s.grid, in<T>(s.first).data(),
                             in<T>(s.second).data(), static_cast<T>(s.step), in<T>(s.dual).data(), to,
                             to + s.first.size(), to + 2 * s.first.size());
  return all;
}

template <class T>
void expect_no_difference_by_threads(const HeunScene<3>& s, bool at_rest) {
  const std::vector<T> alone = duals_of_heun<T>(s, at_rest, 1);
  for (const int threads : {2, 3, 7, 16}) {
    const std::vector<T> together = duals_of_heun<T>(s, at_rest, threads);
    EXPECT_EQ(std::memcmp(together.data(), alone.data(), alone.size() * sizeof(T)), 0) << threads << " threads";
  }
}

// Oracle: the same bits with one thread, whatever a thread's planes are, where velocities reach far and where
// velocities or displacements are no numbers along any axis.
TEST(AdvanceHeun, HasAnAdjointThatDoesNotDependOnTheNumberOfThreads) {
  const testing::ManyThreads many;
  const Lattice<3> grid = {{35, 6, 9}, {1, 1, 1}, {}}, other = {{34, 5, 8}, {1.1, 1.2, 1.05}, {0.2, 0, 0.3}};
  constexpr std::size_t far = 35 * 6 * 7 + 40;  // a site in the seventh plane: nowhere is in the first
  const double nan = std::nan("");
  for (const Lattice<3>& points : {grid, other}) {
    HeunScene<3> s(points, grid);
    s.step = -2.1;
    expect_no_difference_by_threads<double>(s, false);
    expect_no_difference_by_threads<float>(s, false);
    expect_no_difference_by_threads<float>(s, true);
    for (const double odd : {nan, 1e30})
      for (const std::size_t axis : {0, 2}) {
        SCOPED_TRACE(odd);
        HeunScene<3> of_velocity = s, of_place = s;
        of_velocity.first[3 * far + axis] = odd;
        of_place.d[3 * (35 * 5 * 6) + axis] = odd;
        expect_no_difference_by_threads<float>(of_velocity, false);
        expect_no_difference_by_threads<double>(of_velocity, false);
        expect_no_difference_by_threads<float>(of_place, false);
      }
  }
}

// A step by whole samples, but for rounding, may end in a plane more than it seems to. Oracle: one thread. A few of
// these cases need the plane beside.
TEST(AdvanceHeun, HasAnAdjointThatKnowsWhereRoundingLeads) {
  const testing::ManyThreads many;
  for (int k = 0; k < 100; ++k)
    for (const int samples : {1, 3, 5})
      for (const int ulps : {-1, 0, 1}) {
        const double spacing = 0.5 + 0.0077 * k, moved = samples * spacing * (1 + ulps * 6e-8);
        const Lattice<3> grid = {{4, 3, 24}, {1, 1, spacing}, {}};
        HeunScene<3> s(grid, grid);
        s.step = -0.25;
        for (std::size_t i = 0; i < s.d.size(); ++i) {
          s.first[i] = i % 3 == 2 ? moved / 0.25 : 0;
          s.d[i] = i % 3 == 2 ? -samples * spacing * (1 + 6e-8) : 0;
        }
        const std::vector<float> alone = duals_of_heun<float>(s, false, 1),
                                 together = duals_of_heun<float>(s, false, 16);
        EXPECT_EQ(std::memcmp(together.data(), alone.data(), alone.size() * sizeof(float)), 0)
            << samples << " samples of " << spacing << " mm";
      }
}

// Where nothing is compared points may be nowhere. Oracle: the same with all points somewhere, to the last bit.
TEST(AdvanceHeun, HasAnAdjointThatDoesNotLookWhereThereIsNoDual) {
  const testing::ManyThreads many;
  HeunScene<3> s({{35, 6, 9}, {1, 1, 1}, {}}, {{35, 6, 9}, {1, 1, 1}, {}});
  constexpr std::size_t row = 3 * 35 * (6 * 4 + 2), end = row + 3 * 35;
  std::fill(s.dual.begin() + row, s.dual.begin() + end, 0.0);
  const std::vector<float> expected = duals_of_heun<float>(s, false, 1);
  for (std::size_t i = row; i < end; ++i) EXPECT_EQ(expected[2 * s.first.size() + i], 0) << i;
  std::fill(s.d.begin() + row, s.d.begin() + end, std::nan(""));
  for (const int threads : {1, 3}) EXPECT_EQ(duals_of_heun<float>(s, false, threads), expected) << threads;
}

// What is compiled for float has registers of its own. Oracle: the same in double.
TEST(AdvanceHeun, IsTheSameInSinglePrecision) {
  for (const bool at_rest : {false, true}) {
    const HeunScene<3> s({{35, 6, 9}, {1, 1, 1.2}, {0.2, 0, 0.3}}, {{36, 7, 9}, {1, 0.9, 1.2}, {}});
    std::vector<double> moved(s.d.size());
    std::vector<float> moved_in_float(s.d.size());
    advance_heun<3, double>(s.points, at_rest ? nullptr : s.d.data(), s.grid, s.first.data(), s.second.data(), s.step,
                            moved.data());
    advance_heun<3, float>(s.points, at_rest ? nullptr : in<float>(s.d).data(), s.grid, in<float>(s.first).data(),
                           in<float>(s.second).data(), static_cast<float>(s.step), moved_in_float.data());
    for (std::size_t i = 0; i < moved.size(); ++i) ASSERT_NEAR(moved_in_float[i], moved[i], 1e-5) << i;
    const std::vector<double> duals = duals_of_heun<double>(s, at_rest, 1);
    const std::vector<float> duals_in_float = duals_of_heun<float>(s, at_rest, 1);
    for (std::size_t i = 0; i < duals.size(); ++i) ASSERT_NEAR(duals_in_float[i], duals[i], 2e-5) << i;
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
