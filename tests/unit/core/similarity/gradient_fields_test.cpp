#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "core/similarity/similarity.h"
#include "tests/support/random_fields.h"

namespace saltus {
namespace {

const Lattice<2> kLattice{{14, 11}, {1.0, 2.0}, {}};

double energy(const Lattice<2>& lattice, const std::vector<double>& fixed, const std::vector<double>& warped,
              double edge, const double* weights = nullptr) {
  std::vector<double> gradient(fixed.size());
  const auto similarity = make_gradient_fields<2, double>(lattice, edge);
  similarity->prepare(fixed.data(), warped.data(), weights);
  return similarity->evaluate(fixed.data(), warped.data(), weights, gradient.data(), nullptr);
}

// Oracle: the definition, with neighbours replaced by the sample's own value as far as they are hidden.
void expect_the_definition(const Lattice<2>& lattice) {
  const int columns = lattice.size[0], rows = lattice.size[1];
  const std::vector<double> fixed = testing::random_waves<2>(lattice, 1), warped = testing::random_waves<2>(lattice, 2);
  std::vector<double> weights = testing::random_values(lattice.sites(), 3, 0.5);
  for (double& weight : weights) weight = std::clamp(weight + 0.4, 0.0, 1.0);
  const double edge = 0.03;
  double expected = 0;
  for (int y = 0; y < rows; ++y)
    for (int x = 0; x < columns; ++x) {
      const auto gradient = [&](const std::vector<double>& image) {
        const double own = image[static_cast<std::size_t>(columns * y + x)];
        const auto at = [&](int i, int j) {
          if (i < 0 || i >= columns || j < 0 || j >= rows) return own;
          const std::size_t site = static_cast<std::size_t>(columns * j + i);
          return weights[site] * image[site] + (1 - weights[site]) * own;
        };
        return std::pair{(at(x + 1, y) - at(x - 1, y)) / 2, (at(x, y + 1) - at(x, y - 1)) / 4};
      };
      const auto [fx, fy] = gradient(fixed);
      const auto [wx, wy] = gradient(warped);
      const double cosine =
          (fx * wx + fy * wy) / std::sqrt((fx * fx + fy * fy + edge * edge) * (wx * wx + wy * wy + edge * edge));
      expected += 2.0 * weights[static_cast<std::size_t>(columns * y + x)] * (1 - cosine * cosine);
    }
  EXPECT_NEAR(energy(lattice, fixed, warped, edge, weights.data()), expected, 1e-12 * expected);
}

TEST(GradientFields, EqualsTheIntegralOfTheDefinition) {
  expect_the_definition(kLattice);
  expect_the_definition({{261, 4}, {1.0, 2.0}, {}});  // rows of more than two pieces
}

// Closed form: ramps at an angle, away from the border, cost sin^2 of it; the spacing takes part.
TEST(GradientFields, OfTwoRampsIsTheSineOfTheirAngleSquared) {
  const Lattice<2> lattice{{60, 40}, {1.0, 2.0}, {}};
  std::vector<double> fixed(lattice.sites()), warped(lattice.sites());
  for (std::size_t site = 0; site < fixed.size(); ++site) {
    const double x = static_cast<double>(site % 60), y = 2.0 * static_cast<double>(site / 60);
    fixed[site] = x;
    warped[site] = 500 - 40 * (std::cos(0.6) * x + std::sin(0.6) * y);
  }
  const double area = lattice.cell_volume() * lattice.sites(), expected = std::pow(std::sin(0.6), 2);
  EXPECT_NEAR(energy(lattice, fixed, warped, 1e-6) / area, expected, 0.05);  // the border has half its differences
}

// Each image has its own measure of an edge: the units of an image do not matter, whether it is noisy or not.
TEST(GradientFields, DoesNotSeeAnAffineChangeOfIntensity) {
  const std::vector<double> fixed = testing::random_waves<2>(kLattice, 1), noise = testing::random_values(154, 5, 0.1);
  std::vector<double> warped = testing::random_waves<2>(kLattice, 2);
  for (double part : {0.0, 1.0}) {
    for (std::size_t i = 0; i < warped.size(); ++i) warped[i] += part * noise[i];
    std::vector<double> changed = warped;
    for (double& value : changed) value = 7000 - 300 * value;
    const double same = energy(kLattice, fixed, warped, 0);
    EXPECT_NEAR(energy(kLattice, fixed, changed, 0), same, 1e-9 * same);
  }
}

// Noise alone has no edges: two independent noises cost nearly all, and so do an edge and noise.
TEST(GradientFields, TakesNoiseForFlat) {
  const Lattice<2> lattice{{64, 64}, {1, 1}, {}};
  const std::vector<double> one = testing::random_values(lattice.sites(), 1), other = testing::random_values(4096, 2);
  EXPECT_GT(energy(lattice, one, other, 0) / 4096, 0.95);
  EXPECT_GT(energy(lattice, one, one, 0) / 4096, 0.8);
}

TEST(GradientFields, RefusesToBeEvaluatedUnprepared) {
  std::vector<double> image(kLattice.sites(), 0.5), gradient(image.size());
  EXPECT_THROW((make_gradient_fields<2, double>(kLattice, 0.1)
                    ->evaluate(image.data(), image.data(), nullptr, gradient.data(), nullptr)),
               std::logic_error);
}

}  // namespace
}  // namespace saltus
