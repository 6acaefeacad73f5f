#include "core/flow/scatter.h"

#include <gtest/gtest.h>
#include <omp.h>

#include <cmath>
#include <cstring>
#include <limits>

#include "tests/support/finite_differences.h"
#include "tests/support/many_threads.h"
#include "tests/support/random_fields.h"

namespace saltus {
namespace {

using testing::dot;
using testing::random_values;

template <int Dim>
struct Scene {
  Lattice<Dim> from, to;
  std::vector<double> displacement;
};

template <int Dim>
Scene<Dim> scene() {
  Scene<Dim> made;
  if constexpr (Dim == 2)
    made.from = {{12, 9}, {1, 1.5}, {0.3, 0}}, made.to = {{8, 11}, {1.7, 1.2}, {-1, 0.4}};
  else
    made.from = {{7, 6, 8}, {1, 1.5, 1}, {}}, made.to = {{5, 8, 6}, {1.4, 1.1, 1.3}, {0.2, 0, 0.1}};
  // Large enough that some points leave the target lattice.
  made.displacement = random_values(Dim * made.from.sites(), 1, 2.5);
  return made;
}

/// For `scatter`: an interleaved field's values, of all points that `is_wanted`.
template <int Dim, class T, class IsWanted>
auto values_of(const std::vector<T>& field, IsWanted is_wanted) {
  return [&field, is_wanted](std::size_t first, int count, LaneVectors<T>& out, LaneMask& wanted) {
    out = vectors_of<Dim, T>(field.data() + Dim * first, count);
    for (int lane = 0; lane < count; ++lane) wanted[lane] = is_wanted(first + static_cast<std::size_t>(lane));
  };
}
template <int Dim, class T>
auto values_of(const std::vector<T>& field) {
  return values_of<Dim>(field, [](std::size_t) { return true; });
}

// Oracle: <I f, w> = <f, I^T w> with I the interpolation that LinearCell gives.
template <int Dim>
void expect_transpose() {
  const Scene<Dim> s = scene<Dim>();
  const std::vector<double> field = random_values(Dim * s.to.sites(), 2),
                            weights = random_values(Dim * s.from.sites(), 3);
  double left = 0;
  for (int slab = 0; slab < s.from.size[Dim - 1]; ++slab)
    visit_slab<Dim>(s.from, slab, [&](const Index<Dim>& index, std::size_t site) {
      const LinearCell<Dim, double> cell(
          s.to, SitePlacement<Dim, double>(s.from, s.to)(index, s.displacement.data() + Dim * site));
      const auto value = cell.template value<Dim>(field.data());
      for (int c = 0; c < Dim; ++c) left += value[c] * weights[Dim * site + c];
    });
  std::vector<double> scattered(field.size(), 0.0);
  const auto all = BlockMask<Dim>::all(s.from);
  scatter<Dim, double>(MovedPoints<Dim, double>(s.from, all, s.displacement.data(), s.to), s.to,
                       values_of<Dim>(weights), scattered.data());
  EXPECT_NEAR(left, dot(scattered, field), 1e-12 * std::sqrt(dot(field, field) * dot(weights, weights)));
}

TEST(Scatter, IsTheTransposeOfInterpolation) {
  expect_transpose<2>();
  expect_transpose<3>();
}

template <int Dim, class IsWanted>
std::vector<float> scattered_with(int threads, IsWanted is_wanted) {
  omp_set_num_threads(threads);
  const Scene<Dim> s = scene<Dim>();
  const std::vector<float> displacement(s.displacement.begin(), s.displacement.end());
  const auto numbers = random_values(Dim * s.from.sites(), 4);
  const std::vector<float> given(numbers.begin(), numbers.end());
  std::vector<float> sum(Dim * s.to.sites(), 0.5f);
  const auto all = BlockMask<Dim>::all(s.from);
  scatter<Dim, float>(MovedPoints<Dim, float>(s.from, all, displacement.data(), s.to), s.to,
                      values_of<Dim>(given, is_wanted), sum.data());
  return sum;
}

// Oracle: the same bits, whatever the number of threads (more of them than planes, too): whether a group of points is
// all of a thread's planes and has something to add everywhere, or not.
TEST(Scatter, DoesNotDependOnTheNumberOfThreads) {
  const testing::ManyThreads many;
  const auto all = [](std::size_t) { return true; };
  const auto most = [](std::size_t site) { return site % 7 != 0; };
  const std::vector<float> flat = scattered_with<2>(1, most), deep = scattered_with<3>(1, most),
                           whole = scattered_with<3>(1, all);
  for (int threads : {2, 3, 5, 16}) {
    EXPECT_EQ(scattered_with<2>(threads, most), flat) << threads;
    EXPECT_EQ(scattered_with<3>(threads, most), deep) << threads;
    EXPECT_EQ(scattered_with<3>(threads, all), whole) << threads;
  }
}

// What a slab reaches is told by its displacements along the last axis. Oracle: one thread, bit by bit (NaN as bytes).
TEST(Scatter, ReachesTheSameWhateverADisplacementIs) {
  Scene<3> s = scene<3>();
  const std::vector<double> numbers = random_values(3 * s.from.sites(), 4);
  const auto all = BlockMask<3>::all(s.from);
  const testing::ManyThreads many;
  const auto sum_with = [&](int threads, const double* displacement) {
    omp_set_num_threads(threads);
    std::vector<double> sum(3 * s.to.sites(), 0.5);
    scatter<3, double>(MovedPoints<3, double>(s.from, all, displacement, s.to), s.to, values_of<3>(numbers),
                       sum.data());
    return sum;
  };
  const auto expect_same = [&](const double* displacement) {
    const std::vector<double> alone = sum_with(1, displacement);
    for (int threads : {2, 3, 6}) {
      const std::vector<double> together = sum_with(threads, displacement);
      EXPECT_EQ(std::memcmp(together.data(), alone.data(), alone.size() * sizeof(double)), 0) << threads;
    }
  };
  expect_same(nullptr);
  const std::size_t plane = 3 * 7 * 6;  // scalars
  for (const double odd : {std::nan(""), 1e300, -1e300, std::numeric_limits<double>::infinity()}) {
    SCOPED_TRACE(odd);
    s.displacement[4 * plane + 2] = odd;  // along the last axis, in the middle
    expect_same(s.displacement.data());
  }
}

// Oracle: each site as one thread's own, with its cell and what it gave, however many threads there are.
TEST(Scatter, VisitsEachPointAsOneThreadsOwn) {
  const testing::ManyThreads many;
  const Scene<3> s = scene<3>();
  const auto all = BlockMask<3>::all(s.from);
  const MovedPoints<3, double> points(s.from, all, s.displacement.data(), s.to);
  const SitePlacement<3, double> place(s.from, s.to);
  const std::vector<double> numbers = random_values(3 * s.from.sites(), 4);
  for (int threads : {1, 3, 16}) {
    omp_set_num_threads(threads);
    std::vector<int> visits(s.from.sites(), 0);
    std::vector<std::size_t> base(visits.size());
    std::vector<double> given(3 * visits.size()), sum(3 * s.to.sites(), 0.0);
    scatter<3, double>(points, s.to, values_of<3>(numbers), sum.data(),
                       [&](std::size_t first, int count, const CellLanes<3, double>& cells,
                           const LaneVectors<double>& values, const LaneMask& own) {
                         for (int lane = 0; lane < count; ++lane) {
                           if (!own[lane]) continue;
                           const std::size_t site = first + static_cast<std::size_t>(lane);
                           ++visits[site];
                           base[site] = cells.cell(lane).base;
                           put<3>(values[lane], given.data() + 3 * site);
                         }
                       });
    EXPECT_EQ(given, numbers) << threads;
    for (int slab = 0; slab < s.from.size[2]; ++slab)
      visit_slab<3>(s.from, slab, [&](const Index<3>& index, std::size_t site) {
        EXPECT_EQ(visits[site], 1) << threads;
        const LinearCell<3, double> cell(s.to, place(index, s.displacement.data() + 3 * site));
        EXPECT_EQ(base[site], cell.base);
      });
  }
}

// Oracle: LinearCell, point by point; the same bits with any number of threads.
TEST(Scatter, TakesAListOfManyPoints) {
  const testing::ManyThreads many;
  const Lattice<2> target{{7, 40}, {1, 1}, {}};
  const std::size_t count = 1300;
  const std::vector<double> at = random_values(2 * count, 5, 20), values = random_values(2 * count, 6);
  const auto point = [&](std::size_t i) {
    return std::array<double, 2>{3 + at[2 * i] / 6, 40.0 * static_cast<double>(i) / count + at[2 * i + 1] / 10};
  };
  std::vector<double> expected(2 * target.sites(), 0.0);
  for (std::size_t i = 0; i < count; ++i)
    LinearCell<2, double>(target, point(i)).spread<2>({values[2 * i], values[2 * i + 1]}, 0, 40, expected.data());
  omp_set_num_threads(1);
  const auto sum_of = [&] {
    std::vector<double> sum(2 * target.sites(), 0.0);
    scatter<2, double>(listed_points<2, double>(count, point), target, values_of<2>(values), sum.data());
    return sum;
  };
  const std::vector<double> alone = sum_of();
  for (std::size_t i = 0; i < alone.size(); ++i) EXPECT_NEAR(alone[i], expected[i], 1e-13) << i;
  for (int threads : {2, 7}) {
    omp_set_num_threads(threads);
    EXPECT_EQ(sum_of(), alone) << threads;
  }
}

TEST(Scatter, LeavesOutWhatHasNothingToAddAndKeepsTheRest) {
  const Lattice<2> target{{3, 3}, {1, 1}, {}};
  const std::vector<std::array<double, 2>> points = {{1, 1}, {0.5, 2}, {-4, 9}};
  const std::vector<double> given = {1, 1, 2, 20, 3, 30};
  std::vector<double> sum(18, 0.0);
  scatter<2, double>(listed_points<2, double>(points.size(), [&](std::size_t i) { return points[i]; }), target,
                     values_of<2>(given, [](std::size_t i) { return i != 0; }), sum.data());
  EXPECT_EQ(sum, (std::vector<double>{0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1 + 3, 10 + 30, 1, 10, 0, 0}));
}

// What has nothing to add may be nowhere. Oracle: everything is a number.
TEST(Scatter, DoesNotLookWhereNothingIsAdded) {
  Scene<3> s = scene<3>();
  std::vector<double> given = random_values(3 * s.from.sites(), 4);
  for (int c = 0; c < 3; ++c) s.displacement[3 * 100 + c] = std::nan(""), given[3 * 100 + c] = 0;
  std::vector<double> sum(3 * s.to.sites(), 0.0);
  const auto all = BlockMask<3>::all(s.from);
  scatter<3, double>(MovedPoints<3, double>(s.from, all, s.displacement.data(), s.to), s.to,
                     scaled_values<3, double>(given.data(), 1.0), sum.data());
  for (const double value : sum) EXPECT_TRUE(std::isfinite(value));
}

}  // namespace
}  // namespace saltus
