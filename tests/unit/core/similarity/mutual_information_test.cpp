#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "core/similarity/similarity.h"
#include "tests/support/random_fields.h"

namespace saltus {
namespace {

const Lattice<2> kLattice{{40, 30}, {1.0, 2.0}, {}};

double energy(const std::vector<double>& fixed, const std::vector<double>& warped, int bins = 32,
              const double* weights = nullptr) {
  std::vector<double> gradient(fixed.size());
  const auto similarity = make_mutual_information<2, double>(kLattice, bins);
  similarity->prepare(fixed.data(), warped.data(), weights);
  return similarity->evaluate(fixed.data(), warped.data(), weights, gradient.data(), nullptr);
}

// Header: two thirds of the axis for [low, high], the rest for the tails.
double place(double value, double low, double high, double first, double last) {
  const double u = (value - low) / (high - low), x = u < 0 ? 4 * u : u > 1 ? 4 * (u - 1) : 0;
  const double inside = std::min(1.0, std::max(0.0, u)) + 0.25 * x / std::sqrt(1 + x * x);
  return first + (inside + 0.25) / 1.5 * (last - first);
}
double cubic(double x) {
  x = std::abs(x);
  return x < 1 ? 2.0 / 3 - x * x + x * x * x / 2 : x < 2 ? std::pow(2 - x, 3) / 6 : 0;
}
double hat(double x) { return std::max(0.0, 1 - std::abs(x)); }

// Oracle: every sample against every bin, and the sum of p log(p / (p p)).
TEST(MutualInformation, EqualsTheSumOverTheJointHistogram) {
  const std::vector<double> fixed = testing::random_waves<2>(kLattice, 1),
                            warped = testing::random_waves<2>(kLattice, 2);
  std::vector<double> weights = testing::random_values(kLattice.sites(), 3, 0.5);
  for (double& weight : weights) weight = std::max(0.0, weight + 0.3);
  for (int bins : {8, 13}) {
    const auto range = [&](std::vector<double> image) {
      std::vector<double> seen;
      for (std::size_t i = 0; i < image.size(); ++i)
        if (weights[i] > 0) seen.push_back(image[i]);
      std::sort(seen.begin(), seen.end());
      return std::pair{seen[static_cast<std::size_t>(0.01 * (seen.size() - 1))],
                       seen[static_cast<std::size_t>(0.99 * (seen.size() - 1))]};
    };
    const auto [f0, f1] = range(fixed);
    const auto [w0, w1] = range(warped);
    double whole = 0;
    for (double weight : weights) whole += weight;
    std::vector<double> joint(bins * bins, 1e-3 * whole / (bins * bins)), rows(bins), columns(bins);
    for (std::size_t i = 0; i < fixed.size(); ++i)
      for (int k = 0; k < bins; ++k)
        for (int l = 0; l < bins; ++l)
          joint[k * bins + l] += weights[i] * hat(place(fixed[i], f0, f1, 0, bins - 1) - k) *
                                 cubic(place(warped[i], w0, w1, 1, bins - 2) - l);
    double sum = 0;
    for (int k = 0; k < bins; ++k)
      for (int l = 0; l < bins; ++l) {
        sum += joint[k * bins + l];
        rows[k] += joint[k * bins + l];
        columns[l] += joint[k * bins + l];
      }
    EXPECT_NEAR(sum, 1.001 * whole, 1e-9 * whole);  // the windows share every sample out
    double information = 0;
    for (int k = 0; k < bins; ++k)
      for (int l = 0; l < bins; ++l)
        information += joint[k * bins + l] / sum * std::log(joint[k * bins + l] * sum / (rows[k] * columns[l]));
    EXPECT_NEAR(energy(fixed, warped, bins, weights.data()), -2.0 * whole * information, 1e-9 * whole);
  }
}

// Closed form: two levels, half and half, that say everything of each other hold log 2 (the windows do not overlap:
// the levels lie 2/3 of the bins apart; the even thousandth takes a little).
TEST(MutualInformation, OfTwoLevelsIsLogTwo) {
  std::vector<double> fixed(kLattice.sites(), 0.0);
  for (std::size_t i = 0; i < fixed.size(); ++i) fixed[i] = i % 2;
  std::vector<double> warped = fixed;
  for (double& value : warped) value = 700 - 300 * value;
  const double area = kLattice.cell_volume() * kLattice.sites();
  EXPECT_NEAR(energy(fixed, warped), -area * std::log(2), 0.01 * area);
  // Unrelated: every pair of levels as often as any other.
  for (std::size_t i = 0; i < warped.size(); ++i) warped[i] = i / 2 % 2;
  EXPECT_NEAR(energy(fixed, warped), 0, 0.01 * area);
  EXPECT_EQ(energy(std::vector<double>(fixed.size(), 0.3), warped), 0);
}

// The scales of the images do not matter, nor their units.
TEST(MutualInformation, DoesNotSeeAnAffineChangeOfIntensity) {
  const std::vector<double> fixed = testing::random_waves<2>(kLattice, 1),
                            warped = testing::random_waves<2>(kLattice, 2);
  std::vector<double> changed = warped;
  for (double& value : changed) value = 300 * value - 7000;
  EXPECT_NEAR(energy(fixed, changed), energy(fixed, warped), 1e-9 * std::abs(energy(fixed, warped)));
}

TEST(MutualInformation, RefusesToBeEvaluatedUnprepared) {
  std::vector<double> image(kLattice.sites(), 0.5), gradient(image.size());
  EXPECT_THROW((make_mutual_information<2, double>(kLattice, 32)
                    ->evaluate(image.data(), image.data(), nullptr, gradient.data(), nullptr)),
               std::logic_error);
}

}  // namespace
}  // namespace saltus
