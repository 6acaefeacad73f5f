#include <gtest/gtest.h>

#include <cmath>

#include "core/similarity/similarity.h"
#include "tests/support/random_fields.h"

namespace saltus {
namespace {

const Lattice<2> kLattice{{14, 11}, {1.0, 2.0}, {}};

double energy(const std::vector<double>& fixed, const std::vector<double>& warped, double floor,
              const double* weights = nullptr) {
  std::vector<double> gradient(fixed.size());
  return make_global_correlation<2, double>(kLattice, floor)
      ->evaluate(fixed.data(), warped.data(), weights, gradient.data(), nullptr);
}

// Closed form: samples of two signs. With 90 samples of 1 and 64 of -1 in f, and w = f but for the last 10 (of -1),
// E[f] = 26/154, E[w] = 46/154, E[f w] = 134/154.
TEST(GlobalCorrelation, EqualsTheClosedFormOfTwoLevels) {
  std::vector<double> fixed(154, 1.0), warped(154, 1.0);
  std::fill(fixed.begin() + 90, fixed.end(), -1.0);
  std::fill(warped.begin() + 90, warped.end() - 10, -1.0);
  const double f = 26 / 154.0, w = 46 / 154.0, fw = 134 / 154.0, floor = 0.1;
  const double c = (fw - f * w) / std::sqrt((1 - f * f + floor * floor) * (1 - w * w + floor * floor));
  EXPECT_NEAR(energy(fixed, warped, floor), 154 * 2.0 * (1 - c), 1e-11);
  // A mask that shows half of each sample: half of the energy, the same correlation.
  EXPECT_NEAR(energy(fixed, warped, floor, std::vector<double>(154, 0.5).data()), 154 * (1 - c), 1e-11);
}

// Oracle: correlation does not know brightness and contrast.
TEST(GlobalCorrelation, DoesNotSeeAnAffineChangeOfIntensity) {
  const std::vector<double> fixed = testing::random_waves<2>(kLattice, 1),
                            warped = testing::random_waves<2>(kLattice, 2);
  std::vector<double> changed = warped;
  for (double& value : changed) value = 300 * value - 7000;
  const double same = energy(fixed, warped, 1e-9);
  EXPECT_NEAR(energy(fixed, changed, 1e-9), same, 1e-9 * same);
}

}  // namespace
}  // namespace saltus
