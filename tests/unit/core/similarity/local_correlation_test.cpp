#include <gtest/gtest.h>

#include <omp.h>

#include <array>
#include <cmath>
#include <cstdlib>
#include <limits>

#include "core/similarity/similarity.h"
#include "tests/support/finite_differences.h"
#include "tests/support/random_fields.h"

namespace saltus {
namespace {

/// Windows around each sample, or of cells of two.
template <int Dim, class T>
auto make(int cell) {
  return cell == 2 ? make_cell_correlation<Dim, T> : make_local_correlation<Dim, T>;
}

const Lattice<2> kLattice{{14, 11}, {1.0, 2.0}, {}};

struct Images {
  std::vector<double> fixed = testing::random_waves<2>(kLattice, 1), warped = testing::random_waves<2>(kLattice, 2);
};

double energy(const std::vector<double>& fixed, const std::vector<double>& warped, double floor,
              const double* weights = nullptr, int cell = 2) {
  std::vector<double> gradient(fixed.size());
  return make<2, double>(cell)(kLattice, 3.0, floor)
      ->evaluate(fixed.data(), warped.data(), weights, gradient.data(), nullptr);
}

/// One axis as the header says of windows of half width r samples.
struct Axis {
  int size, cell, radius;

  int cells() const { return (size + cell - 1) / cell; }
  double counts(int cell_at, int sample) const {
    const int by = std::abs(sample / cell - cell_at);
    return by < radius || by == 0 ? 1 : by > radius ? 0 : cell == 2 ? 0.25 : 1;
  }
};
Axis axis_of(int size, double radius, int cell) {
  const int r = std::max(1, static_cast<int>(std::lround(radius)));
  if (size < 2) return {size, 1, 0};
  return r == 1 || cell == 1 ? Axis{size, 1, r} : Axis{size, 2, (r + 1) / 2};
}

/// Every window term by term, in double and two passes: the energy a volume, and what each window adds to the slopes in
/// the warped image and in the weights at each of its samples.
double window_by_window(const std::array<Axis, 3>& axes, double floor, const std::vector<double>& fixed,
                        const std::vector<double>& warped, const std::vector<double>& weights,
                        std::vector<double>& gradient, std::vector<double>& weight_gradient) {
  gradient.assign(fixed.size(), 0);
  weight_gradient.assign(fixed.size(), 0);
  double energy = 0;
  const auto visit = [&](const std::array<int, 3>& at, auto&& sample) {
    std::array<int, 3> from, to;
    for (std::size_t a = 0; a < 3; ++a) {
      from[a] = std::max(0, (at[a] - axes[a].radius) * axes[a].cell);
      to[a] = std::min(axes[a].size, (at[a] + axes[a].radius + 1) * axes[a].cell);
    }
    for (int z = from[2]; z < to[2]; ++z)
      for (int y = from[1]; y < to[1]; ++y)
        for (int x = from[0]; x < to[0]; ++x) {
          const auto i = static_cast<std::size_t>(x + axes[0].size * (y + axes[1].size * z));
          const bool is_own = x / axes[0].cell == at[0] && y / axes[1].cell == at[1] && z / axes[2].cell == at[2];
          sample(i, axes[0].counts(at[0], x) * axes[1].counts(at[1], y) * axes[2].counts(at[2], z), is_own);
        }
  };
  std::array<int, 3> at;
  for (at[2] = 0; at[2] < axes[2].cells(); ++at[2])
    for (at[1] = 0; at[1] < axes[1].cells(); ++at[1])
      for (at[0] = 0; at[0] < axes[0].cells(); ++at[0]) {
        double sum = 0, own = 0, f = 0, w = 0, var_f = floor * floor, var_w = floor * floor, cov = 0;
        visit(at, [&](std::size_t i, double counts, bool is_own) {
          const double weight = counts * weights[i];
          sum += weight, f += weight * fixed[i], w += weight * warped[i], own += is_own ? weights[i] : 0;
        });
        if (sum < 1e-6) {
          energy += own;
          visit(at, [&](std::size_t i, double, bool is_own) { weight_gradient[i] += is_own; });
          continue;
        }
        f /= sum, w /= sum;
        visit(at, [&](std::size_t i, double counts, bool) {
          const double share = counts * weights[i] / sum, df = fixed[i] - f, dw = warped[i] - w;
          var_f += share * df * df, var_w += share * dw * dw, cov += share * df * dw;
        });
        const double q = 1 / std::sqrt(var_f * var_w), c = cov * q;
        energy += own * (1 - c);
        visit(at, [&](std::size_t i, double counts, bool is_own) {
          const double df = fixed[i] - f, dw = warped[i] - w, share = own * counts / sum;
          gradient[i] -= share * weights[i] * (q * df - c / var_w * dw);
          // Means move as well, which changes nothing of the first order; the floor is no part of what is averaged.
          const double of_f = (df * df - (var_f - floor * floor)) / var_f,
                       of_w = (dw * dw - (var_w - floor * floor)) / var_w;
          weight_gradient[i] += (is_own ? 1 - c : 0) - share * (q * (df * dw - cov) - c / 2 * (of_f + of_w));
        });
      }
  return energy;
}

// 3 mm are 3 samples of 1 mm, and 2 of 2 mm.
TEST(LocalCorrelation, EqualsTheSumOverWindows) {
  const Images images;
  std::vector<double> weights = testing::random_values(kLattice.sites(), 3, 0.5), ones(weights.size(), 1), unused,
                      unused_too;
  for (double& weight : weights) weight = std::max(0.0, weight + 0.3);
  for (int cell : {1, 2})
    for (const std::vector<double>* w : {&ones, &weights}) {
      const double expected = 2 * window_by_window({axis_of(14, 3, cell), axis_of(1, 0, cell), axis_of(11, 1.5, cell)},
                                                   0.05, images.fixed, images.warped, *w, unused, unused_too);
      EXPECT_NEAR(energy(images.fixed, images.warped, 0.05, w == &ones ? nullptr : w->data(), cell), expected,
                  1e-10 * expected);
    }
}

// Oracle: correlation does not know brightness and contrast; only the floor, in intensity units, does.
TEST(LocalCorrelation, DoesNotSeeAnAffineChangeOfIntensityButForTheFloor) {
  const Images images;
  std::vector<double> changed = images.warped;
  for (double& value : changed) value = 3 * value - 0.7;
  const double same = energy(images.fixed, images.warped, 1e-7);
  EXPECT_NEAR(energy(images.fixed, changed, 1e-7), same, 1e-8 * same);
  const double floored = energy(images.fixed, images.warped, 0.02);
  EXPECT_NEAR(energy(images.fixed, changed, 0.06), energy(images.fixed, images.warped, 0.06), 0.05 * same);
  EXPECT_NE(energy(images.fixed, changed, 0.02), floored);
}

TEST(LocalCorrelation, OfAnInvertedImageIsNearlyTwo) {
  const Images images;
  std::vector<double> inverted = images.fixed;
  for (double& value : inverted) value = -value;
  const double area = kLattice.cell_volume() * kLattice.sites();
  EXPECT_NEAR(energy(images.fixed, inverted, 1e-4), 2 * area, 1e-3 * area);
  EXPECT_NEAR(energy(images.fixed, images.fixed, 1e-4), 0, 1e-3 * area);
}

// In float, at unit range, a flat window must not become noise that looks like correlation.
TEST(LocalCorrelation, GivesNoCorrelationToFlatWindowsInFloat) {
  const Lattice<3> lattice{{12, 11, 10}, {1, 1, 1}, {}};
  for (float level : {0.0f, 0.3f, 1.0f, -1.7f}) {
    const std::vector<float> fixed(lattice.sites(), level), warped(lattice.sites(), 1 - level);
    std::vector<float> gradient(lattice.sites());
    const double per_voxel = make<3, float>(2)(lattice, 3.0, 0.01)
                                 ->evaluate(fixed.data(), warped.data(), nullptr, gradient.data(), nullptr) /
                             lattice.sites();
    EXPECT_NEAR(per_voxel, 1, 0.02) << level;
    for (float slope : gradient) ASSERT_LT(std::abs(slope), 0.05f) << level;
  }
}

// In float: behind a strong edge, whose squares are a million times the floor's, a flat part is flat again, in every
// direction that windows move. Oracles: the energy in double; no slope where there is no edge.
TEST(LocalCorrelation, ForgetsAnEdgeThatAWindowHasLeft) {
  const Lattice<3> lattice{{24, 24, 24}, {1, 1, 1}, {}};
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<float> fixed(lattice.sites(), 0.0f), warped(lattice.sites(), 0.0f), gradient(lattice.sites());
    for (int z = 0; z < 24; ++z)
      visit_slab<3>(lattice, z, [&](const Index<3>& index, std::size_t site) {
        // Pairs of opposite values, so that the mean is 0 and the flat part as well; no two pairs alike, so that a sum
        // that is rounded does not come back to 0 by chance.
        const float size = 1000.1f + 0.37f * static_cast<float>((index[0] / 2 * 7 + index[1] * 3 + index[2] * 5) % 11);
        const float value = index[0] % 2 ? size : -size;
        if (index[axis] < 6) fixed[site] = value, warped[site] = 0.9f * value;
      });
    const double energy = make_local_correlation<3, float>(lattice, 2.0, 0.01)
                              ->evaluate(fixed.data(), warped.data(), nullptr, gradient.data(), nullptr);
    const std::vector<double> exact_fixed(fixed.begin(), fixed.end()), exact_warped(warped.begin(), warped.end());
    std::vector<double> unused(lattice.sites());
    const double expected = make_local_correlation<3, double>(lattice, 2.0, 0.01)
                                ->evaluate(exact_fixed.data(), exact_warped.data(), nullptr, unused.data(), nullptr);
    EXPECT_NEAR(energy, expected, 1e-4 * static_cast<double>(lattice.sites())) << axis;
    for (int z = 0; z < 24; ++z)
      visit_slab<3>(lattice, z, [&](const Index<3>& index, std::size_t site) {
        EXPECT_TRUE(index[axis] < 6 + 4 || gradient[site] == 0.0f) << axis << " " << index[axis];
      });
  }
}

// Oracle: the same images with numbers where nothing counts.
TEST(LocalCorrelation, DoesNotReadWhatHasNoWeight) {
  const Images images;
  std::vector<double> weights(kLattice.sites(), 1.0), fixed = images.fixed, warped = images.warped;
  for (std::size_t i : {3u, 40u, 41u, 55u, 56u, 100u}) {
    weights[i] = 0;
    fixed[i] = std::numeric_limits<double>::quiet_NaN();
    warped[i] = i % 2 ? std::numeric_limits<double>::infinity() : fixed[i];
  }
  const auto similarity = make_local_correlation<2, double>(kLattice, 3.0, 0.05);
  std::vector<double> expected(weights.size()), found(weights.size());
  const double value =
      similarity->evaluate(images.fixed.data(), images.warped.data(), weights.data(), expected.data(), nullptr);
  EXPECT_NEAR(similarity->evaluate(fixed.data(), warped.data(), weights.data(), found.data(), nullptr), value,
              1e-12 * value);
  for (std::size_t i = 0; i < found.size(); ++i) EXPECT_NEAR(found[i], expected[i], 1e-12) << i;
}

// Oracle: weights of 1, over several bands and chunks of planes.
TEST(LocalCorrelation, WithoutWeightsIsAsWithWeightsOfOne) {
  for (const Lattice<3>& lattice : {Lattice<3>{{300, 40, 5}, {1, 1, 1}, {}}, Lattice<3>{{5, 9, 180}, {1, 1, 1}, {}}}) {
    const std::vector<double> fixed = testing::random_waves<3>(lattice, 4),
                              warped = testing::random_waves<3>(lattice, 5), ones(lattice.sites(), 1.0);
    const auto similarity = make_local_correlation<3, double>(lattice, 3, 0.05);
    std::vector<double> expected(lattice.sites()), found(lattice.sites());
    const double value = similarity->evaluate(fixed.data(), warped.data(), ones.data(), expected.data(), nullptr);
    EXPECT_NEAR(similarity->evaluate(fixed.data(), warped.data(), nullptr, found.data(), nullptr), value,
                1e-10 * value);
    for (std::size_t i = 0; i < found.size(); ++i) ASSERT_NEAR(found[i], expected[i], 1e-10) << i;
  }
}

// Lattices of several bands of rows (wide windows of long rows) and of more planes than one sweep takes. Oracles: every
// window term by term; central differences along a random direction, for both gradients at once.
TEST(LocalCorrelation, TilesDoNotShow) {
  struct Case {
    Index<3> size;
    int radius, cell;
  };
  for (const Case& one : {Case{{300, 40, 5}, 7, 2}, Case{{300, 40, 5}, 7, 1}, Case{{5, 4, 180}, 2, 2},
                          Case{{5, 4, 180}, 2, 1}, Case{{900, 19, 3}, 4, 2}}) {
    const Lattice<3> lattice{one.size, {1, 1, 1}, {}};
    const std::vector<double> fixed = testing::random_waves<3>(lattice, 4),
                              warped = testing::random_waves<3>(lattice, 5);
    std::vector<double> weights = testing::random_values(lattice.sites(), 6, 0.4);
    for (double& weight : weights) weight = std::max(0.01, weight + 0.4);
    const std::unique_ptr<Similarity<3, double>> similarity = make<3, double>(one.cell)(lattice, one.radius, 0.05);
    std::vector<double> gradient(lattice.sites()), weight_gradient(lattice.sites());
    const double energy =
        similarity->evaluate(fixed.data(), warped.data(), weights.data(), gradient.data(), weight_gradient.data());

    std::vector<double> unused, unused_too;
    const double expected =
        window_by_window({axis_of(one.size[0], one.radius, one.cell), axis_of(one.size[1], one.radius, one.cell),
                          axis_of(one.size[2], one.radius, one.cell)},
                         0.05, fixed, warped, weights, unused, unused_too);
    EXPECT_NEAR(energy, expected, 1e-9 * expected);

    const std::vector<double> turn = testing::random_waves<3>(lattice, 7),
                              shown = testing::random_values(lattice.sites(), 8, 1);
    const auto energy_at = [&](double step) {
      std::vector<double> moved = warped, weighed = weights, unused(lattice.sites());
      for (std::size_t i = 0; i < moved.size(); ++i) moved[i] += step * turn[i], weighed[i] += step * 0.01 * shown[i];
      return similarity->evaluate(fixed.data(), moved.data(), weighed.data(), unused.data(), nullptr);
    };
    double slope = 0;
    for (std::size_t i = 0; i < gradient.size(); ++i)
      slope += gradient[i] * turn[i] + weight_gradient[i] * 0.01 * shown[i];
    const double h = 1e-4;
    EXPECT_NEAR((energy_at(h) - energy_at(-h)) / (2 * h), slope, 1e-6 * std::abs(slope) + 1e-7 * expected);
  }
}

template <class T>
void expect_window_by_window(const Lattice<3>& lattice, double radius_mm, int cell, bool is_weighted,
                             double tolerance) {
  std::array<Axis, 3> axes;
  for (std::size_t a = 0; a < 3; ++a) axes[a] = axis_of(lattice.size[a], radius_mm / lattice.spacing[a], cell);
  const std::vector<double> waves = testing::random_waves<3>(lattice, 4), others = testing::random_waves<3>(lattice, 5);
  const std::vector<T> fixed(waves.begin(), waves.end()), warped(others.begin(), others.end());
  std::vector<T> weights(lattice.sites(), T(1)), gradient(lattice.sites());
  if (is_weighted) {
    const std::vector<double> some = testing::random_values(lattice.sites(), 6, 0.5);
    for (std::size_t i = 0; i < weights.size(); ++i) weights[i] = static_cast<T>(std::max(0.0, some[i] + 0.3));
  }
  std::vector<T> weight_gradient(is_weighted ? lattice.sites() : 0);
  const double energy = make<3, T>(cell)(lattice, radius_mm, 0.05)
                            ->evaluate(fixed.data(), warped.data(), is_weighted ? weights.data() : nullptr,
                                       gradient.data(), is_weighted ? weight_gradient.data() : nullptr);
  std::vector<double> expected, expected_of_weights;
  const double volume = lattice.cell_volume();
  const double sum = volume * window_by_window(axes, 0.05, {fixed.begin(), fixed.end()}, {warped.begin(), warped.end()},
                                               {weights.begin(), weights.end()}, expected, expected_of_weights);
  EXPECT_NEAR(energy, sum, tolerance * sum);
  double largest = 0;
  for (double slope : expected) largest = std::max(largest, volume * std::abs(slope));
  for (std::size_t i = 0; i < expected.size(); ++i)
    ASSERT_NEAR(gradient[i], volume * expected[i], 10 * tolerance * largest) << i;
  if (!is_weighted) return;
  for (double slope : expected_of_weights) largest = std::max(largest, volume * std::abs(slope));
  for (std::size_t i = 0; i < expected.size(); ++i)
    ASSERT_NEAR(weight_gradient[i], volume * expected_of_weights[i], 10 * tolerance * largest) << i;
}

// Rows that do and do not fill the registers, and of several strips; axes shorter than a window, and of one sample;
// windows of each radius that is summed in a way of its own, and of different ones along the axes.
TEST(LocalCorrelation, EqualsTheSumOverWindowsForEveryWayToSumThem) {
  const std::vector<Lattice<3>> lattices{{{16, 9, 8}, {1, 1, 1}, {}},    {{17, 6, 7}, {1, 1, 1}, {}},
                                         {{37, 10, 9}, {1, 1.5, 3}, {}}, {{3, 2, 4}, {1, 1, 1}, {}},
                                         {{1, 12, 9}, {1, 1, 1}, {}},    {{12, 1, 9}, {1, 1, 1}, {}},
                                         {{40, 9, 1}, {1, 1, 1}, {}},    {{403, 3, 3}, {1, 1, 1}, {}}};
  for (const Lattice<3>& lattice : lattices)
    for (int radius = 1; radius <= 6; ++radius)
      for (int way = 0; way < 4; ++way) {
        const int cell = 1 + way / 2;
        const bool is_weighted = way % 2 == 1;
        SCOPED_TRACE(::testing::Message()
                     << lattice.size[0] << " x " << lattice.size[1] << " x " << lattice.size[2] << ", " << radius
                     << ", cells of " << cell << (is_weighted ? ", weighted" : ""));
        expect_window_by_window<double>(lattice, radius, cell, is_weighted, 1e-11);
        expect_window_by_window<float>(lattice, radius, cell, is_weighted, 1e-5);
      }
}

// In float, images far from 0, so large that not all of them is read to find about where they are; of the second mask
// no part that is looked at first shows anything. Oracle: double.
TEST(LocalCorrelation, KeepsItsAccuracyFarFromZeroInLargeImages) {
  const Lattice<3> lattice{{60, 41, 33}, {1, 1, 1}, {}};
  ASSERT_GT(lattice.sites(), 65536u);
  const std::vector<double> waves = testing::random_waves<3>(lattice, 4), others = testing::random_waves<3>(lattice, 5);
  std::vector<float> fixed(lattice.sites()), warped(lattice.sites()), everything(lattice.sites(), 1),
      spot(lattice.sites(), 0);
  for (std::size_t i = 0; i < fixed.size(); ++i) {
    fixed[i] = 32768 + static_cast<float>(waves[i]);
    warped[i] = 32768 - static_cast<float>(others[i]);
  }
  for (std::size_t i = 41 * 1024 + 100; i < 41 * 1024 + 900; ++i) spot[i] = 1;
  const std::vector<double> exact_fixed(fixed.begin(), fixed.end()), exact_warped(warped.begin(), warped.end());
  for (const std::vector<float>* weights : {static_cast<std::vector<float>*>(nullptr), &everything, &spot}) {
    std::vector<float> gradient(lattice.sites());
    std::vector<double> expected(lattice.sites()), exact_weights;
    if (weights) exact_weights.assign(weights->begin(), weights->end());
    const double energy =
        make_local_correlation<3, float>(lattice, 2, 0.01)
            ->evaluate(fixed.data(), warped.data(), weights ? weights->data() : nullptr, gradient.data(), nullptr);
    const double sum = make_local_correlation<3, double>(lattice, 2, 0.01)
                           ->evaluate(exact_fixed.data(), exact_warped.data(), weights ? exact_weights.data() : nullptr,
                                      expected.data(), nullptr);
    EXPECT_NEAR(energy, sum, 1e-6 * sum);
    double largest = 0;
    for (double slope : expected) largest = std::max(largest, std::abs(slope));
    for (std::size_t i = 0; i < expected.size(); ++i) ASSERT_NEAR(gradient[i], expected[i], 1e-4 * largest) << i;
  }
}

// With several threads the planes are cut into chunks, of which each makes its windows anew.
TEST(LocalCorrelation, HasTheSameBitsForAnyNumberOfThreads) {
  const int threads = omp_get_max_threads();
  for (int cell : {1, 2})
    for (const Lattice<3>& lattice :
         {Lattice<3>{{210, 61, 70}, {1, 1, 1}, {}}, Lattice<3>{{40, 21, 150}, {1, 1, 1}, {}}}) {
      const std::vector<double> waves = testing::random_waves<3>(lattice, 4),
                                others = testing::random_waves<3>(lattice, 5);
      const std::vector<float> fixed(waves.begin(), waves.end()), warped(others.begin(), others.end()),
          weights(lattice.sites(), 0.7f);
      for (const float* w : {static_cast<const float*>(nullptr), weights.data()}) {
        std::vector<std::vector<float>> gradients;
        std::vector<double> energies;
        for (int count : {1, 2, 5}) {
          omp_set_num_threads(count);
          gradients.emplace_back(2 * lattice.sites());
          energies.push_back(make<3, float>(cell)(lattice, 2, 0.05)
                                 ->evaluate(fixed.data(), warped.data(), w, gradients.back().data(),
                                            w ? gradients.back().data() + lattice.sites() : nullptr));
        }
        omp_set_num_threads(threads);
        for (std::size_t i = 1; i < energies.size(); ++i) {
          EXPECT_EQ(energies[i], energies[0]);
          EXPECT_TRUE(gradients[i] == gradients[0]);
        }
      }
    }
}

}  // namespace
}  // namespace saltus
