#include <gtest/gtest.h>

#include <cmath>

#include "core/similarity/similarity.h"
#include "tests/support/finite_differences.h"
#include "tests/support/random_fields.h"

namespace saltus {
namespace {

const Lattice<2> kLattice{{14, 11}, {1.0, 2.0}, {}};

struct Images {
  std::vector<double> fixed = testing::random_waves<2>(kLattice, 1), warped = testing::random_waves<2>(kLattice, 2);
};

double energy(const std::vector<double>& fixed, const std::vector<double>& warped, double floor,
              const double* weights = nullptr) {
  std::vector<double> gradient(fixed.size());
  return make_local_correlation<2, double>(kLattice, 3.0, floor)
      ->evaluate(fixed.data(), warped.data(), weights, gradient.data(), nullptr);
}

// Oracle: mean, variance and covariance of every window, term by term, in two passes.
TEST(LocalCorrelation, EqualsTheSumOverWindows) {
  const Images images;
  std::vector<double> weights = testing::random_values(kLattice.sites(), 3, 0.5);
  for (double& weight : weights) weight = std::max(0.0, weight + 0.3);
  const double floor = 0.05;
  for (const double* w : {static_cast<const double*>(nullptr), static_cast<const double*>(weights.data())}) {
    double expected = 0;
    const int rx = 3, ry = 2;  // 3 mm; 1.5 samples round to 2
    for (int y = 0; y < 11; ++y)
      for (int x = 0; x < 14; ++x) {
        const auto window = [&](auto&& term) {
          double sum = 0;
          for (int j = std::max(0, y - ry); j <= std::min(10, y + ry); ++j)
            for (int i = std::max(0, x - rx); i <= std::min(13, x + rx); ++i) {
              const std::size_t at = static_cast<std::size_t>(14 * j + i);
              sum += (w ? w[at] : 1.0) * term(images.fixed[at], images.warped[at]);
            }
          return sum;
        };
        const double count = window([](double, double) { return 1.0; });
        const double f0 = window([](double f, double) { return f; }) / count,
                     w0 = window([](double, double v) { return v; }) / count;
        const double vf = window([&](double f, double) { return (f - f0) * (f - f0); }) / count;
        const double vw = window([&](double, double v) { return (v - w0) * (v - w0); }) / count;
        const double cov = window([&](double f, double v) { return (f - f0) * (v - w0); }) / count;
        const double weight = w ? w[static_cast<std::size_t>(14 * y + x)] : 1.0;
        expected += 2.0 * weight * (1 - cov / std::sqrt((vf + floor * floor) * (vw + floor * floor)));
      }
    EXPECT_NEAR(energy(images.fixed, images.warped, floor, w), expected, 1e-10 * expected);
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
    const double per_voxel = make_local_correlation<3, float>(lattice, 3.0, 0.01)
                                 ->evaluate(fixed.data(), warped.data(), nullptr, gradient.data(), nullptr) /
                             lattice.sites();
    EXPECT_NEAR(per_voxel, 1, 0.02) << level;
    for (float slope : gradient) ASSERT_LT(std::abs(slope), 0.05f) << level;
  }
}

}  // namespace
}  // namespace saltus
