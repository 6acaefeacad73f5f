// Oracle: gradients in closed form, and noise of known size.
#include "core/grid/contrast.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "tests/support/lattices.h"

namespace saltus {
namespace {

using testing::unit_lattice;

template <int Dim, class Function>
std::vector<double> image(const Lattice<Dim>& lattice, Function&& value) {
  std::vector<double> samples(lattice.sites());
  for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab)
    visit_slab<Dim>(lattice, slab, [&](const Index<Dim>& index, std::size_t site) { samples[site] = value(index); });
  return samples;
}

std::vector<double> noise(std::size_t count, double sd) {
  std::mt19937 random(11);
  std::normal_distribution<double> normal(0, sd);
  std::vector<double> samples(count);
  for (double& sample : samples) sample = normal(random);
  return samples;
}

template <int Dim>
double rms_of(const Lattice<Dim>& lattice, const std::vector<double>& samples, const double* weights = nullptr) {
  return rms_gradient<Dim, double>(lattice, samples.data(), weights, {{}, lattice.size});
}

TEST(RmsGradient, IsThatOfALinearImageOverTheFinestSpacing) {
  Lattice<3> lattice = unit_lattice<3>({12, 9, 7});
  lattice.spacing = {2, 1.5, 6};
  // Of 0.3, 0.4 and 1.2 a sample: over 1.5 mm 0.225, 0.4 and 0.3.
  const auto ramp = image<3>(lattice, [](const Index<3>& i) { return 0.3 * i[0] - 0.4 * i[1] + 1.2 * i[2]; });
  EXPECT_NEAR(rms_of<3>(lattice, ramp), std::sqrt(0.225 * 0.225 + 0.16 + 0.09), 1e-12);
}

// A sine of wave number k: central differences have k cos(k x) sin(k) / k, the product a sample apart its mean times
// cos(k) / 2.
TEST(RmsGradient, IsThatOfAWave) {
  const Lattice<2> lattice = unit_lattice<2>({403, 8});
  const double k = 2 * M_PI / 20;
  const auto wave = image<2>(lattice, [&](const Index<2>& i) { return std::sin(k * i[0]); });
  EXPECT_NEAR(rms_of<2>(lattice, wave), std::sin(k) * std::sqrt(std::cos(k) / 2), 1e-6);
}

TEST(RmsGradient, DoesNotCountWhiteNoise) {
  const Lattice<2> lattice = unit_lattice<2>({200, 180});
  const auto plain = noise(lattice.sites(), 0.05);
  // Differences alone would have 0.05.
  EXPECT_LT(rms_of<2>(lattice, plain), 0.01);
  auto ramp = image<2>(lattice, [](const Index<2>& i) { return 0.03 * i[0] + 0.04 * i[1]; });
  for (std::size_t i = 0; i < ramp.size(); ++i) ramp[i] += plain[i];
  EXPECT_NEAR(rms_of<2>(lattice, ramp), 0.05, 0.001);
}

TEST(RmsGradient, LeavesOutWhatAMaskHidesAndAxesTooShort) {
  const Lattice<2> lattice = unit_lattice<2>({40, 3});
  auto ramp = image<2>(lattice, [](const Index<2>& i) { return 0.2 * i[0] + 7 * i[1]; });
  std::vector<double> weights(ramp.size(), 1);
  for (std::size_t y = 0; y < 3; ++y) {
    ramp[40 * y + 20] = 1e6;
    weights[40 * y + 20] = 0;
  }
  EXPECT_NEAR(rms_of<2>(lattice, ramp, weights.data()), 0.2, 1e-12);
  const std::vector<double> hidden(ramp.size(), 0);
  EXPECT_EQ(rms_of<2>(lattice, ramp, hidden.data()), std::numeric_limits<double>::infinity());
}

TEST(RmsGradient, IsThatOfTheBox) {
  const Lattice<3> lattice = unit_lattice<3>({20, 16, 12});
  const auto in_box = [](const Index<3>& i) {
    return i[0] >= 3 && i[0] < 12 && i[1] >= 4 && i[1] < 9 && i[2] >= 5 && i[2] < 12;
  };
  const auto ramp =
      image<3>(lattice, [&](const Index<3>& i) { return in_box(i) ? 0.1 * i[0] - 0.2 * i[1] + 0.2 * i[2] : 50.0; });
  EXPECT_NEAR((rms_gradient<3, double>(lattice, ramp.data(), nullptr, {{3, 4, 5}, {12, 9, 12}})), 0.3, 1e-12);
}

}  // namespace
}  // namespace saltus
