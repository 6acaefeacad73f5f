// What every similarity owes its callers. A new one joins by one more entry in `similarities()`.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <ostream>

#include "core/registration/options.h"
#include "core/similarity/similarity.h"
#include "tests/support/finite_differences.h"
#include "tests/support/random_fields.h"

namespace saltus {
namespace {

using testing::dot;
using testing::random_values;
using testing::random_waves;

struct Member {
  SimilarityType type;
  double identical;  ///< the most that equal images may cost, per mm^Dim (a floor keeps lncc above 0)
  double largest;    ///< upper end of the range, per mm^Dim
};
void PrintTo(const Member& member, std::ostream* out) { *out << to_string(member.type); }

std::vector<Member> similarities() {
  return {{SimilarityType::Ssd, 0, std::numeric_limits<double>::infinity()}, {SimilarityType::Lncc, 0.05, 2}};
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

class SimilaritySuite : public ::testing::TestWithParam<Member> {
 protected:
  template <int Dim>
  static double value(SimilarityType type, const std::vector<double>& fixed, const std::vector<double>& warped,
                      const std::vector<double>& weights) {
    std::vector<double> gradient(fixed.size());
    return make<Dim>(type)->evaluate(fixed.data(), warped.data(), weights.empty() ? nullptr : weights.data(),
                                     gradient.data(), nullptr);
  }
};

template <int Dim>
void expect_range_and_symmetry(const Member& member, auto&& value) {
  const std::vector<double> fixed = random_waves<Dim>(lattice<Dim>(), 1), warped = random_waves<Dim>(lattice<Dim>(), 2);
  const double volume = lattice<Dim>().cell_volume() * lattice<Dim>().sites();
  const double same = value(fixed, fixed), different = value(fixed, warped);
  EXPECT_GE(same, 0);
  EXPECT_LE(same, member.identical * volume);
  EXPECT_GT(different, same + 0.01 * volume);
  EXPECT_LE(different, member.largest * volume);
  EXPECT_NEAR(value(warped, fixed), different, 1e-12 * different);
  std::vector<double> inverted = fixed;
  for (double& v : inverted) v = -v;
  EXPECT_GT(value(fixed, inverted), different);
  EXPECT_LE(value(fixed, inverted), member.largest * volume);
}

TEST_P(SimilaritySuite, IsLowestForEqualImagesSymmetricAndInItsRange) {
  expect_range_and_symmetry<2>(GetParam(), [&](auto&& a, auto&& b) { return value<2>(GetParam().type, a, b, {}); });
  expect_range_and_symmetry<3>(GetParam(), [&](auto&& a, auto&& b) { return value<3>(GetParam().type, a, b, {}); });
}

// Header: null weights are 1 everywhere.
TEST_P(SimilaritySuite, TakesNoWeightsForOnes) {
  const std::vector<double> fixed = random_waves<3>(lattice<3>(), 1), warped = random_waves<3>(lattice<3>(), 2);
  const double without = value<3>(GetParam().type, fixed, warped, {});
  EXPECT_NEAR(value<3>(GetParam().type, fixed, warped, std::vector<double>(fixed.size(), 1.0)), without,
              1e-13 * without);
}

// Oracle: central differences along random directions.
template <int Dim>
void expect_gradients(SimilarityType type, const std::vector<double>& weights) {
  const auto similarity = make<Dim>(type);
  const std::vector<double> fixed = random_waves<Dim>(lattice<Dim>(), 1), warped = random_waves<Dim>(lattice<Dim>(), 2);
  std::vector<double> gradient(fixed.size()), weight_gradient(fixed.size()), ignored(fixed.size());
  const double energy = similarity->evaluate(fixed.data(), warped.data(), weights.empty() ? nullptr : weights.data(),
                                             gradient.data(), weights.empty() ? nullptr : weight_gradient.data());
  for (std::uint64_t seed : {11, 12, 13}) {
    std::vector<double> along = random_values(fixed.size(), seed);
    const double slope = testing::slope_along(
        [&](const std::vector<double>& at) {
          return similarity->evaluate(fixed.data(), at.data(), weights.empty() ? nullptr : weights.data(),
                                      ignored.data(), nullptr);
        },
        warped, along);
    EXPECT_NEAR(dot(gradient, along), slope, 1e-6 * std::sqrt(dot(gradient, gradient) * dot(along, along)));
    if (weights.empty()) continue;
    // Samples of weight 0 are left where they are: below 0 a weight has no meaning.
    for (std::size_t i = 0; i < along.size(); ++i)
      if (weights[i] == 0) along[i] = 0;
    const double weight_slope = testing::slope_along(
        [&](const std::vector<double>& at) {
          return similarity->evaluate(fixed.data(), warped.data(), at.data(), ignored.data(), nullptr);
        },
        weights, along);
    EXPECT_NEAR(dot(weight_gradient, along), weight_slope, 1e-6 * std::abs(energy));
  }
  // A mask that moves uncovers samples at its border: a one-sided difference of second order. (Deeper inside, where no
  // window sees anything, the energy has a kink.)
  if (weights.empty()) return;
  std::vector<double> along(weights.size(), 0.0);
  const std::size_t hidden = weights.size() / 3;
  std::fill_n(along.begin() + static_cast<std::ptrdiff_t>(hidden - 14), 14, 1.0);
  const auto at = [&](double step) {
    return similarity->evaluate(fixed.data(), warped.data(), testing::moved(weights, step, along).data(),
                                ignored.data(), nullptr);
  };
  const double slope = (-3 * energy + 4 * at(1e-5) - at(2e-5)) / 2e-5;
  EXPECT_NEAR(dot(weight_gradient, along), slope, 1e-3 * std::abs(slope));
}

TEST_P(SimilaritySuite, HasTheGradientsOfItsValue) {
  expect_gradients<2>(GetParam().type, {});
  expect_gradients<3>(GetParam().type, {});
  expect_gradients<2>(GetParam().type, mask<2>());
  expect_gradients<3>(GetParam().type, mask<3>());
}

template <int Dim>
void expect_masked_samples_ignored(SimilarityType type) {
  const std::vector<double> weights = mask<Dim>();
  std::vector<double> fixed = random_waves<Dim>(lattice<Dim>(), 1), warped = random_waves<Dim>(lattice<Dim>(), 2);
  std::vector<double> gradient(fixed.size()), changed(fixed.size());
  const auto similarity = make<Dim>(type);
  const double before = similarity->evaluate(fixed.data(), warped.data(), weights.data(), gradient.data(), nullptr);
  for (std::size_t i = 0; i < weights.size(); ++i) {
    if (weights[i] != 0) continue;
    EXPECT_EQ(gradient[i], 0);
    fixed[i] = i % 2 ? 1e30 : -4e25;
    warped[i] = i % 3 ? -1e28 : 7;
  }
  EXPECT_EQ(similarity->evaluate(fixed.data(), warped.data(), weights.data(), changed.data(), nullptr), before);
  EXPECT_EQ(changed, gradient);
}

TEST_P(SimilaritySuite, IgnoresWhatTheMaskHides) {
  expect_masked_samples_ignored<2>(GetParam().type);
  expect_masked_samples_ignored<3>(GetParam().type);
}

TEST_P(SimilaritySuite, IsFiniteForFlatImagesAndEmptyMasks) {
  const std::size_t count = lattice<3>().sites();
  const std::vector<double> flat(count, 0.4), other(count, 0.9), waves = random_waves<3>(lattice<3>(), 1);
  for (const auto& weights : {std::vector<double>{}, mask<3>(), std::vector<double>(count, 0.0)})
    for (const auto& [fixed, warped] : {std::pair{flat, flat}, {flat, other}, {flat, waves}, {waves, flat}}) {
      std::vector<double> gradient(count, std::nan("")), weight_gradient(count, std::nan(""));
      const double energy = make<3>(GetParam().type)
                                ->evaluate(fixed.data(), warped.data(), weights.empty() ? nullptr : weights.data(),
                                           gradient.data(), weight_gradient.data());
      EXPECT_TRUE(std::isfinite(energy));
      for (double slope : gradient) ASSERT_TRUE(std::isfinite(slope));
      for (double slope : weight_gradient) ASSERT_TRUE(std::isfinite(slope));
      if (!weights.empty() && weights.back() == 0) {
        EXPECT_EQ(energy, 0);
      }
    }
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
    energies[k] = make_similarity<2, double>(GetParam().type, where, parameters, 1.0)
                      ->evaluate(sample(where, 0).data(), sample(where, 0.5).data(), nullptr, gradient.data(), nullptr);
  }
  EXPECT_NEAR(energies[1], energies[0], 0.03 * energies[0]);
}

INSTANTIATE_TEST_SUITE_P(Similarities, SimilaritySuite, ::testing::ValuesIn(similarities()),
                         [](const auto& info) { return to_string(info.param.type); });

}  // namespace
}  // namespace saltus
