// Oracle: the same row, tap by tap, summed in double.
#include "core/kernels/sliding_moments.h"

#include <gtest/gtest.h>
#include <omp.h>

#include <cmath>
#include <limits>

#include "tests/support/many_threads.h"
#include "tests/support/random_fields.h"

namespace saltus {
namespace {

struct Row {
  std::string name;
  std::vector<double> taps;
  std::array<TapRun, 2> runs;
  int degree;
};

std::vector<Row> rows(double sigma, double spacing) {
  const KernelTaps taps = cell_averaged_taps(*make_wendland_profile(sigma), spacing);
  std::vector<Row> all = {{"value", taps.value, taps.value_runs, taps.degree},
                          {"slope", taps.slope, taps.slope_runs, taps.degree - 1},
                          {"curvature", taps.curvature, taps.curvature_runs, taps.degree - 2},
                          {"slope_gram", taps.slope_gram, taps.slope_gram_runs, taps.degree - 1}};
  for (std::size_t k = 0; k < 4; ++k)
    all.push_back({all[k].name + " transposed", reversed(all[k].taps), reversed(all[k].runs), all[k].degree});
  return all;
}

// What the runs claim: inside them the taps are a polynomial of their degree, and no other tap could join.
TEST(TapRuns, AreAllThatIsPolynomial) {
  for (double sigma : {4.0, 7.3, 12.9})
    for (const Row& row : rows(sigma, 1.0)) {
      SCOPED_TRACE(row.name + " of width " + std::to_string(sigma));
      const AxisTaps<double> taps(row.taps, row.runs, row.degree);
      ASSERT_TRUE(taps.has_runs());
      EXPECT_LE(taps.singles.size(), 6u);
      const double largest = std::abs(*std::max_element(row.taps.begin(), row.taps.end(),
                                                        [](double a, double b) { return std::abs(a) < std::abs(b); }));
      for (const auto& p : taps.polynomials)
        for (int t = p.run.first; t <= p.run.last; ++t)
          EXPECT_NEAR(p.at[static_cast<std::size_t>(t - p.run.first + 1)],
                      row.taps[static_cast<std::size_t>(t + taps.radius())], 1e-12 * largest)
              << "tap " << t;
    }
}

TEST(TapRuns, AreNoneForAKernelThatIsNoPolynomial) {
  const KernelTaps taps = cell_averaged_taps(*make_gaussian_profile(9), 1.0);
  EXPECT_FALSE(AxisTaps<double>(taps.value, taps.value_runs, taps.degree).has_runs());
}

/// Largest error, as a multiple of epsilon times the sum of |tap| |x| of the widest window.
template <int Dim, class T>
double error_against_direct(const Lattice<Dim>& lattice, int channels, int axis, const Row& row, Combine combine) {
  const std::size_t count = lattice.sites() * static_cast<std::size_t>(channels);
  const std::vector<double> values = testing::random_values(count, 1), before = testing::random_values(count, 2);
  const std::vector<T> in(values.begin(), values.end());
  std::vector<T> out(before.begin(), before.end());
  const AxisTaps<T> taps(row.taps, row.runs, row.degree, ConvolutionMethod::Moments);
  convolve_axis_by_moments<Dim, T>(lattice, channels, axis, taps, combine, in.data(), out.data());

  std::size_t stride = static_cast<std::size_t>(channels);
  for (int a = 0; a < axis; ++a) stride *= static_cast<std::size_t>(lattice.size[a]);
  double sum_of_taps = 0, worst = 0;
  for (double tap : row.taps) sum_of_taps += std::abs(tap);
  for (std::size_t k = 0; k < count; ++k) {
    const int i = static_cast<int>(k / stride % static_cast<std::size_t>(lattice.size[axis]));
    double expected = combine == Combine::Add ? static_cast<double>(static_cast<T>(before[k])) : 0.0;
    for (int t = -taps.radius(); t <= taps.radius(); ++t)
      if (i - t >= 0 && i - t < lattice.size[axis])
        expected += row.taps[static_cast<std::size_t>(t + taps.radius())] *
                    static_cast<double>(
                        in[k - static_cast<std::size_t>(i) * stride + static_cast<std::size_t>(i - t) * stride]);
    worst = std::max(worst, std::abs(static_cast<double>(out[k]) - expected));
  }
  return worst / (std::numeric_limits<T>::epsilon() * std::max(1.0, sum_of_taps));
}

// The bound of the header, for |x| <= 1. Lines shorter than a run, as long, and much longer: no error is carried along.
template <class T>
void expect_direct_result() {
  for (double sigma : {2.0, 3.5, 6.0, 11.7, 40.0})
    for (const Row& row : rows(sigma, 1.0))
      for (Combine combine : {Combine::Replace, Combine::Add}) {
        SCOPED_TRACE(row.name + " of width " + std::to_string(sigma));
        // In double the rounding of the taps shows too, which come from differences of sigma^2: the oracle has them as
        // they are, the polynomials smooth.
        const double bound = 4 * (sigma + 4) + 1 + (sizeof(T) == sizeof(double) ? sigma * sigma / 4 : 0);
        for (int axis = 0; axis < 2; ++axis) {
          for (const Index<2>& size : {Index<2>{5, 7}, Index<2>{41, 40}, Index<2>{1, 83}})
            EXPECT_LT((error_against_direct<2, T>({size, {1, 1}, {}}, 2, axis, row, combine)), bound) << size[0];
        }
        for (int axis = 0; axis < 3; ++axis)
          EXPECT_LT((error_against_direct<3, T>({{9, 12, 10}, {1, 1, 1}, {}}, 3, axis, row, combine)), bound);
        EXPECT_LT((error_against_direct<2, T>({{600, 2}, {1, 1}, {}}, 1, 0, row, combine)), bound);
        EXPECT_LT((error_against_direct<2, T>({{3, 600}, {1, 1}, {}}, 1, 1, row, combine)), bound);
      }
}

TEST(SlidingMoments, GiveWhatTapByTapGivesInFloat) { expect_direct_result<float>(); }
TEST(SlidingMoments, GiveWhatTapByTapGivesInDouble) { expect_direct_result<double>(); }

// Far from everything that is not zero nothing is left, not even a rounding error: exact zeros stay exact.
TEST(SlidingMoments, LeaveExactZerosOutOfReach) {
  const Lattice<2> lattice{{300, 4}, {1, 1}, {}};
  for (const Row& row : rows(9, 1.0)) {
    std::vector<float> in(2 * lattice.sites(), 0.0f), out(in.size(), 1.0f);
    for (int i = 40; i < 60; ++i) in[static_cast<std::size_t>(2 * (300 + i))] = 1.0f / static_cast<float>(i);
    convolve_axis_by_moments<2, float>(lattice, 2, 0,
                                       AxisTaps<float>(row.taps, row.runs, row.degree, ConvolutionMethod::Moments),
                                       Combine::Replace, in.data(), out.data());
    for (int i = 75; i < 300; ++i) ASSERT_EQ(out[static_cast<std::size_t>(2 * (300 + i))], 0.0f) << row.name << i;
  }
}

// What an ill number does stays where its window reaches.
TEST(SlidingMoments, DoNotCarryANaNAlongTheLine) {
  const Lattice<2> lattice{{300, 1}, {1, 1}, {}};
  const Row row = rows(9, 1.0).front();
  std::vector<float> in(lattice.sites(), 1.0f), out(in.size());
  in[100] = std::numeric_limits<float>::quiet_NaN();
  convolve_axis_by_moments<2, float>(lattice, 1, 0,
                                     AxisTaps<float>(row.taps, row.runs, row.degree, ConvolutionMethod::Moments),
                                     Combine::Replace, in.data(), out.data());
  EXPECT_TRUE(std::isnan(out[100]));
  for (int i : {0, 80, 120, 299}) EXPECT_TRUE(std::isfinite(out[static_cast<std::size_t>(i)])) << i;
}

TEST(SlidingMoments, AreTheSameBitByBitForAnyNumberOfThreads) {
  const Lattice<3> lattice{{37, 23, 19}, {1, 1, 1}, {}};
  const std::vector<double> values = testing::random_values(3 * lattice.sites(), 7);
  const std::vector<float> in(values.begin(), values.end());
  const testing::ManyThreads many;
  for (const Row& row : rows(8, 1.0))
    for (int axis = 0; axis < 3; ++axis) {
      std::vector<float> results[2];
      for (int threads : {1, 2}) {
        omp_set_num_threads(threads);
        results[threads - 1].resize(in.size());
        convolve_axis_by_moments<3, float>(lattice, 3, axis,
                                           AxisTaps<float>(row.taps, row.runs, row.degree, ConvolutionMethod::Moments),
                                           Combine::Replace, in.data(), results[threads - 1].data());
      }
      EXPECT_EQ(results[0], results[1]) << row.name << " along " << axis;
    }
}

}  // namespace
}  // namespace saltus
