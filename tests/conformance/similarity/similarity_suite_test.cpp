// What every similarity owes its callers. All that core/registration/options.h lists take part; a new one needs what
// `traits` says of it.
#include <gtest/gtest.h>
#include <omp.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "core/registration/options.h"
#include "core/similarity/similarity.h"
#include "tests/support/finite_differences.h"
#include "tests/support/many_threads.h"
#include "tests/support/random_fields.h"

namespace saltus {
namespace {

using testing::dot;
using testing::random_values;
using testing::random_waves;

/// What the headers promise; energies per mm^Dim.
struct Traits {
  double lowest, largest;  ///< the range
  double identical;        ///< the most that equal images may cost (floors keep some above their lowest)
  bool is_symmetric;       ///< the images may change places
  bool sees_inversion;     ///< an image and its negative are unlike
  bool sees_flat;          ///< being flat is something to agree or disagree on
};

Traits traits(SimilarityType type) {
  constexpr double inf = std::numeric_limits<double>::infinity();
  switch (type) {  // no default: the compiler names whoever is missing
    case SimilarityType::Ssd:
      return {0, inf, 0, true, true, true};
    case SimilarityType::Ncc:
      return {0, 2, 1e-4, true, true, false};
    case SimilarityType::Lncc:
      return {0, 2, 0.05, true, true, false};
    case SimilarityType::Mi:
      return {-std::log(32.0), 0, -1, false, false, false};
    case SimilarityType::Ngf:
      return {0, 1, 0.2, true, false, false};
    case SimilarityType::Mind:
      return {0, 1, 0, true, false, true};
  }
  throw std::logic_error("a similarity without traits");
}

template <int Dim>
Lattice<Dim> lattice() {
  if constexpr (Dim == 2)
    return {{13, 10}, {1.0, 1.5}, {}};
  else
    return {{8, 7, 6}, {1.0, 1.5, 2.0}, {}};
}

template <int Dim>
std::unique_ptr<Similarity<Dim, double>> make(SimilarityType type) {
  return make_similarity<Dim, double>(type, lattice<Dim>(), {}, 1.0);
}

/// Weights of 0, 1 and in between; the first third is 0.
template <int Dim>
std::vector<double> mask() {
  std::vector<double> weights = random_values(lattice<Dim>().sites(), 7, 0.5);
  for (std::size_t i = 0; i < weights.size(); ++i)
    weights[i] = i < weights.size() / 3 ? 0.0 : i % 5 == 0 ? 1.0 : weights[i] + 0.5;
  return weights;
}

template <class T>
const T* pointer(const std::vector<T>& weights) {
  return weights.empty() ? nullptr : weights.data();
}

class SimilaritySuite : public ::testing::TestWithParam<SimilarityType> {
 protected:
  template <int Dim>
  static double value(SimilarityType type, const std::vector<double>& fixed, const std::vector<double>& warped,
                      const std::vector<double>& weights) {
    std::vector<double> gradient(fixed.size());
    const auto similarity = make<Dim>(type);
    similarity->prepare(fixed.data(), warped.data(), pointer(weights));
    return similarity->evaluate(fixed.data(), warped.data(), pointer(weights), gradient.data(), nullptr);
  }
};

template <int Dim>
void expect_range_and_symmetry(const Traits& promised, auto&& value) {
  const std::vector<double> fixed = random_waves<Dim>(lattice<Dim>(), 1), warped = random_waves<Dim>(lattice<Dim>(), 2);
  const double volume = lattice<Dim>().cell_volume() * lattice<Dim>().sites();
  const double same = value(fixed, fixed), different = value(fixed, warped);
  EXPECT_GE(same, promised.lowest * volume);
  EXPECT_LE(same, promised.identical * volume);
  EXPECT_GT(different, same + 0.01 * volume);
  EXPECT_LE(different, promised.largest * volume);
  if (promised.is_symmetric) {
    EXPECT_NEAR(value(warped, fixed), different, 1e-12 * std::abs(different));
  }
  std::vector<double> inverted = fixed;
  for (double& v : inverted) v = -v;
  const double negative = value(fixed, inverted);
  EXPECT_LE(negative, promised.largest * volume);
  if (promised.sees_inversion) {
    EXPECT_GT(negative, different);
  } else {
    EXPECT_NEAR(negative, same, 0.1 * (different - same));
  }
}

TEST_P(SimilaritySuite, IsLowestForEqualImagesAndInItsRange) {
  const Traits promised = traits(GetParam());
  expect_range_and_symmetry<2>(promised, [&](auto&& a, auto&& b) { return value<2>(GetParam(), a, b, {}); });
  expect_range_and_symmetry<3>(promised, [&](auto&& a, auto&& b) { return value<3>(GetParam(), a, b, {}); });
}

// Header: null weights are 1 everywhere.
TEST_P(SimilaritySuite, TakesNoWeightsForOnes) {
  const std::vector<double> fixed = random_waves<3>(lattice<3>(), 1), warped = random_waves<3>(lattice<3>(), 2);
  const double without = value<3>(GetParam(), fixed, warped, {});
  EXPECT_NEAR(value<3>(GetParam(), fixed, warped, std::vector<double>(fixed.size(), 1.0)), without,
              1e-13 * std::abs(without));
}

/// A smooth pair for the lattice, prepared.
template <int Dim>
struct Pair {
  Pair(SimilarityType type, const Lattice<Dim>& lattice, std::vector<double> mask)
      : fixed(random_waves<Dim>(lattice, 1)),
        warped(random_waves<Dim>(lattice, 2)),
        weights(std::move(mask)),
        gradient(fixed.size()),
        weight_gradient(fixed.size()),
        similarity(make_similarity<Dim, double>(type, lattice, {}, 1.0)) {
    similarity->prepare(fixed.data(), warped.data(), pointer(weights));
    energy = similarity->evaluate(fixed.data(), warped.data(), pointer(weights), gradient.data(),
                                  weights.empty() ? nullptr : weight_gradient.data());
  }
  double at_warped(const std::vector<double>& image) {
    return similarity->evaluate(fixed.data(), image.data(), pointer(weights), ignored.data(), nullptr);
  }
  double at_weights(const std::vector<double>& mask) {
    return similarity->evaluate(fixed.data(), warped.data(), mask.data(), ignored.data(), nullptr);
  }

  std::vector<double> fixed, warped, weights, gradient, weight_gradient, ignored = std::vector<double>(fixed.size());
  std::unique_ptr<Similarity<Dim, double>> similarity;
  double energy;
};

// Oracle: central differences along random directions.
template <int Dim>
void expect_gradients(SimilarityType type, const Lattice<Dim>& lattice, const std::vector<double>& weights) {
  Pair<Dim> pair(type, lattice, weights);
  const auto at_warped = [&](const std::vector<double>& image) { return pair.at_warped(image); };
  const auto at_weights = [&](const std::vector<double>& mask) { return pair.at_weights(mask); };
  const double volume = lattice.cell_volume();
  for (std::uint64_t seed : {11, 12, 13}) {
    std::vector<double> along = random_values(pair.fixed.size(), seed);
    EXPECT_NEAR(dot(pair.gradient, along), testing::slope_along(at_warped, pair.warped, along),
                1e-6 * std::sqrt(dot(pair.gradient, pair.gradient) * dot(along, along)) + 1e-8 * volume);
    if (weights.empty()) continue;
    // Samples of weight 0 are left where they are: below 0 a weight has no meaning.
    for (std::size_t i = 0; i < along.size(); ++i)
      if (weights[i] == 0) along[i] = 0;
    EXPECT_NEAR(dot(pair.weight_gradient, along), testing::slope_along(at_weights, weights, along),
                1e-6 * std::sqrt(dot(pair.weight_gradient, pair.weight_gradient) * dot(along, along)) + 1e-8 * volume);
  }
}

/// A mask that moves uncovers samples at its border: a one-sided difference of second order. (Deeper inside, where no
/// window sees anything, an energy may have a kink.)
template <int Dim>
void expect_uncovering_slope(SimilarityType type) {
  Pair<Dim> pair(type, lattice<Dim>(), mask<Dim>());
  std::vector<double> along(pair.weights.size(), 0.0);
  const std::size_t hidden = along.size() / 3;
  std::fill_n(along.begin() + static_cast<std::ptrdiff_t>(hidden - 14), 14, 1.0);
  const auto at = [&](double step) { return pair.at_weights(testing::moved(pair.weights, step, along)); };
  const double slope = (-3 * pair.energy + 4 * at(1e-5) - at(2e-5)) / 2e-5;
  EXPECT_NEAR(dot(pair.weight_gradient, along), slope, 1e-3 * std::abs(slope));
}

TEST_P(SimilaritySuite, HasTheGradientsOfItsValue) {
  expect_gradients<2>(GetParam(), lattice<2>(), {});
  expect_gradients<3>(GetParam(), lattice<3>(), {});
  expect_gradients<2>(GetParam(), lattice<2>(), mask<2>());
  expect_gradients<3>(GetParam(), lattice<3>(), mask<3>());
  expect_uncovering_slope<2>(GetParam());
  expect_uncovering_slope<3>(GetParam());
}

// Oracle: the definition of the derivative, |E(w + e d) - E(w) - e <g, d>| falls as e^2.
TEST_P(SimilaritySuite, HasTaylorSlopeTwo) {
  for (const auto& weights : {std::vector<double>{}, mask<3>()}) {
    Pair<3> pair(GetParam(), lattice<3>(), weights);
    const std::vector<double> along = random_values(pair.fixed.size(), 21);
    const auto remainder = [&](double step) {
      const double change = pair.at_warped(testing::moved(pair.warped, step, along)) - pair.energy;
      return std::abs(change - step * dot(pair.gradient, along));
    };
    EXPECT_NEAR(std::log10(remainder(1e-3) / remainder(1e-4)), 2, 0.2);
  }
}

TEST_P(SimilaritySuite, TakesThinAndAnisotropicLattices) {
  for (const Lattice<3>& thin : {Lattice<3>{{9, 8, 6}, {1, 1, 10}, {}}, Lattice<3>{{9, 8, 3}, {1, 1, 5}, {}},
                                 Lattice<3>{{9, 8, 1}, {1, 1, 3}, {}}, Lattice<3>{{1, 9, 1}, {2, 1, 1}, {}},
                                 Lattice<3>{{2, 2, 2}, {1, 1, 1}, {}}, Lattice<3>{{1, 1, 1}, {1, 1, 1}, {}}}) {
    SCOPED_TRACE(::testing::PrintToString(thin.size));
    expect_gradients<3>(GetParam(), thin, {});
    expect_gradients<3>(GetParam(), thin, std::vector<double>(thin.sites(), 0.5));
  }
  expect_gradients<2>(GetParam(), Lattice<2>{{2, 2}, {1, 1}, {}}, {});
  expect_gradients<2>(GetParam(), Lattice<2>{{17, 1}, {1, 1}, {}}, {});
}

template <int Dim>
void expect_masked_samples_ignored(SimilarityType type) {
  const std::vector<double> weights = mask<Dim>();
  std::vector<double> fixed = random_waves<Dim>(lattice<Dim>(), 1), warped = random_waves<Dim>(lattice<Dim>(), 2);
  const auto similarity = make<Dim>(type);
  struct Found {
    double value;
    std::vector<double> gradient;
  };
  const auto evaluated = [&](bool has_weight_gradient) {
    std::vector<double> gradient(fixed.size()), weight_gradient(fixed.size());
    const double value = similarity->evaluate(fixed.data(), warped.data(), weights.data(), gradient.data(),
                                              has_weight_gradient ? weight_gradient.data() : nullptr);
    return Found{value, gradient};
  };
  similarity->prepare(fixed.data(), warped.data(), weights.data());
  const Found before = evaluated(false), before_with = evaluated(true);
  for (std::size_t i = 0; i < weights.size(); ++i) {
    if (weights[i] != 0) continue;
    EXPECT_EQ(before.gradient[i], 0);
    fixed[i] = i % 2 ? 1e30 : std::nan("");
    warped[i] = i % 3 ? -1e28 : i % 5 ? 7 : std::nan("");
  }
  similarity->prepare(fixed.data(), warped.data(), weights.data());
  const Found hidden = evaluated(false), hidden_with = evaluated(true);
  EXPECT_EQ(hidden.value, before.value);
  EXPECT_EQ(hidden.gradient, before.gradient);
  // What showing such a sample would cost is no number; what is shown costs what it did, to rounding (which products a
  // compiler joins with a sum differs) what it costs where nobody asks for that.
  EXPECT_EQ(hidden_with.value, before_with.value);
  EXPECT_EQ(hidden_with.gradient, before_with.gradient);
  EXPECT_NEAR(before_with.value, before.value, 1e-14 * std::abs(before.value));
  double largest = 0;
  for (double slope : before.gradient) largest = std::max(largest, std::abs(slope));
  for (std::size_t i = 0; i < fixed.size(); ++i)
    ASSERT_NEAR(before_with.gradient[i], before.gradient[i], 1e-14 * largest) << i;
}

TEST_P(SimilaritySuite, IgnoresWhatTheMaskHides) {
  expect_masked_samples_ignored<2>(GetParam());
  expect_masked_samples_ignored<3>(GetParam());
}

TEST_P(SimilaritySuite, IsFiniteForFlatImagesAndEmptyMasks) {
  const std::size_t count = lattice<3>().sites();
  const std::vector<double> flat(count, 0.4), other(count, 0.9), waves = random_waves<3>(lattice<3>(), 1);
  for (const auto& weights : {std::vector<double>{}, mask<3>(), std::vector<double>(count, 0.0)})
    for (const auto& [fixed, warped] : {std::pair{flat, flat}, {flat, other}, {flat, waves}, {waves, flat}}) {
      std::vector<double> gradient(count, std::nan("")), weight_gradient(count, std::nan(""));
      const auto similarity = make<3>(GetParam());
      similarity->prepare(fixed.data(), warped.data(), pointer(weights));
      const double energy =
          similarity->evaluate(fixed.data(), warped.data(), pointer(weights), gradient.data(), weight_gradient.data());
      EXPECT_TRUE(std::isfinite(energy));
      for (double slope : gradient) ASSERT_TRUE(std::isfinite(slope));
      for (double slope : weight_gradient) ASSERT_TRUE(std::isfinite(slope));
      if (!weights.empty() && weights.back() == 0) {
        EXPECT_EQ(energy, 0);
        for (double slope : gradient) ASSERT_EQ(slope, 0);
      }
      // Nothing to see: no direction is better than another, up to rounding over the floor.
      if (fixed == flat && !traits(GetParam()).sees_flat) {
        for (double slope : gradient) ASSERT_NEAR(slope, 0, 1e-7);
      }
    }
}

// Where no window sees anything, an energy may have a kink; what it says there is what the first sample alone costs.
TEST_P(SimilaritySuite, KnowsWhatTheFirstSampleToBeSeenCosts) {
  Pair<3> pair(GetParam(), lattice<3>(), std::vector<double>(lattice<3>().sites(), 0.0));
  const double volume = lattice<3>().cell_volume();
  for (std::size_t site : {std::size_t{0}, std::size_t{100}, pair.weights.size() - 1}) {
    std::vector<double> weights = pair.weights;
    weights[site] = 1e-3;
    EXPECT_NEAR(pair.weight_gradient[site], pair.at_weights(weights) / 1e-3, 0.01 * volume);
  }
}

// Values that no preparation has seen, far outside of the range, stay finite.
TEST_P(SimilaritySuite, IsFiniteForValuesOutOfRange) {
  Pair<2> pair(GetParam(), lattice<2>(), {});
  for (double extreme : {-1e6, 1e6}) {
    std::vector<double> warped = pair.warped;
    for (std::size_t i = 0; i < warped.size(); i += 3) warped[i] = extreme;
    std::vector<double> gradient(warped.size());
    const double energy =
        pair.similarity->evaluate(pair.fixed.data(), warped.data(), nullptr, gradient.data(), nullptr);
    EXPECT_TRUE(std::isfinite(energy));
    EXPECT_LE(energy, traits(GetParam()).largest * lattice<2>().cell_volume() * lattice<2>().sites());
    for (double slope : gradient) ASSERT_TRUE(std::isfinite(slope));
  }
}

// Whoever evaluates has to see it: no finite energy, or a gradient that is not.
TEST_P(SimilaritySuite, HidesNoValueThatIsNoNumber) {
  for (bool is_fixed : {false, true}) {
    Pair<3> pair(GetParam(), lattice<3>(), {});
    std::vector<double> fixed = pair.fixed, warped = pair.warped, gradient(fixed.size());
    (is_fixed ? fixed : warped)[fixed.size() / 2] = std::nan("");
    if (is_fixed) pair.similarity->prepare(fixed.data(), warped.data(), nullptr);
    const double energy = pair.similarity->evaluate(fixed.data(), warped.data(), nullptr, gradient.data(), nullptr);
    EXPECT_FALSE(std::isfinite(energy));
  }
}

// Oracle: the same in double. An offset of hundreds of ranges, as unsigned scanner data have, must not cost the digits.
TEST_P(SimilaritySuite, AgreesInFloatAndDouble) {
  const Lattice<3> where{{40, 30, 20}, {1, 1, 1.5}, {}};
  for (double offset : {0.0, 300.0}) {
    std::vector<double> fixed = random_waves<3>(where, 1), warped = random_waves<3>(where, 2);
    for (double& v : fixed) v = static_cast<float>(v + offset);
    for (double& v : warped) v = static_cast<float>(v - offset);
    if (GetParam() == SimilarityType::Ssd && offset != 0) continue;  // an offset is a difference
    const std::vector<float> fixed_float(fixed.begin(), fixed.end()), warped_float(warped.begin(), warped.end());
    std::vector<double> gradient(fixed.size());
    std::vector<float> gradient_float(fixed.size());
    const auto precise = make_similarity<3, double>(GetParam(), where, {}, 1.0);
    const auto quick = make_similarity<3, float>(GetParam(), where, {}, 1.0);
    precise->prepare(fixed.data(), warped.data(), nullptr);
    quick->prepare(fixed_float.data(), warped_float.data(), nullptr);
    const double expected = precise->evaluate(fixed.data(), warped.data(), nullptr, gradient.data(), nullptr);
    EXPECT_NEAR(quick->evaluate(fixed_float.data(), warped_float.data(), nullptr, gradient_float.data(), nullptr),
                expected, 1e-4 * std::abs(expected));
    double error = 0;
    for (std::size_t i = 0; i < fixed.size(); ++i) error += std::pow(gradient_float[i] - gradient[i], 2);
    EXPECT_LT(std::sqrt(error / dot(gradient, gradient)), 2e-3) << "offset " << offset;
  }
}

// Oracle: the same bits, whatever the number of threads.
TEST_P(SimilaritySuite, DoesNotDependOnTheNumberOfThreads) {
  const Lattice<3> where{{33, 30, 21}, {1, 1, 1.5}, {}};
  const std::vector<double> fixed = random_waves<3>(where, 1), warped = random_waves<3>(where, 2);
  std::vector<double> weights = random_values(fixed.size(), 3, 0.5);
  for (double& weight : weights) weight = std::max(0.0, weight + 0.3);
  const std::vector<float> f(fixed.begin(), fixed.end()), w(warped.begin(), warped.end()),
      mask(weights.begin(), weights.end());
  struct Outcome {
    double energy;
    std::vector<float> gradient, weight_gradient;
    bool operator==(const Outcome&) const = default;
  };
  const testing::ManyThreads many;
  const auto run = [&](int threads) {
    omp_set_num_threads(threads);
    Outcome outcome{0, std::vector<float>(f.size()), std::vector<float>(f.size())};
    const auto similarity = make_similarity<3, float>(GetParam(), where, {}, 1.0);
    similarity->prepare(f.data(), w.data(), mask.data());
    outcome.energy =
        similarity->evaluate(f.data(), w.data(), mask.data(), outcome.gradient.data(), outcome.weight_gradient.data());
    return outcome;
  };
  const Outcome alone = run(1);
  EXPECT_TRUE(run(2) == alone);
  EXPECT_TRUE(run(8) == alone);
}

// An integral: the same images on a grid of half the spacing mean the same.
TEST_P(SimilaritySuite, CarriesTheCellVolume) {
  const Lattice<2> coarse{{40, 40}, {1, 1}, {}}, fine{{80, 80}, {0.5, 0.5}, {-0.25, -0.25}};
  const auto sample = [](const Lattice<2>& where, double phase) {
    std::vector<double> image(where.sites());
    for (int slab = 0; slab < where.size[1]; ++slab)
      visit_slab<2>(where, slab, [&](const Index<2>& i, std::size_t site) {
        image[site] = 0.5 + 0.4 * std::sin(0.25 * (i[0] * where.spacing[0] + where.offset[0]) + phase) *
                                std::cos(0.2 * (i[1] * where.spacing[1] + where.offset[1]));
      });
    return image;
  };
  double energies[2];
  for (int k : {0, 1}) {
    const Lattice<2>& where = k ? fine : coarse;
    std::vector<double> gradient(where.sites());
    SimilarityOptions parameters;
    parameters.lncc_radius_voxels = 6;
    parameters.mind_radius_voxels = 0;  // no box has the same width on both
    const auto similarity = make_similarity<2, double>(GetParam(), where, parameters, 1.0);
    const std::vector<double> fixed = sample(where, 0), warped = sample(where, 0.5);
    similarity->prepare(fixed.data(), warped.data(), nullptr);
    energies[k] = similarity->evaluate(fixed.data(), warped.data(), nullptr, gradient.data(), nullptr);
  }
  EXPECT_NEAR(energies[1], energies[0], 0.03 * std::abs(energies[0]));
}

INSTANTIATE_TEST_SUITE_P(Similarities, SimilaritySuite, ::testing::ValuesIn(all_similarities()),
                         [](const auto& info) { return to_string(info.param); });

}  // namespace
}  // namespace saltus
