// Oracle: images made of a known structure and normal noise of known size.
#include "core/grid/noise.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "tests/support/lattices.h"

namespace saltus {
namespace {

using testing::unit_lattice;

/// A smooth hill, an edge, a flat half, and noise.
template <int Dim, class T>
std::vector<T> scene(const Lattice<Dim>& lattice, double noise, bool has_flat_half) {
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  std::vector<T> samples(lattice.sites());
  for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab)
    visit_slab<Dim>(lattice, slab, [&](const Index<Dim>& index, std::size_t site) {
      const double x = index[0], y = index[1];
      samples[site] =
          static_cast<T>(100 * std::exp(-(x * x + y * y) / 900) + (y > 20 ? 40 : 0) + noise * normal(random));
      if (has_flat_half && x < lattice.size[0] / 2) samples[site] = 3;
    });
  return samples;
}

template <int Dim, class T>
double sd_of(const Lattice<Dim>& lattice, const std::vector<T>& samples) {
  return noise_sd<Dim, T>(lattice, samples.data(), nullptr);
}

TEST(NoiseSd, MeasuresWhiteNoiseOnStructure) {
  const Lattice<2> plane = unit_lattice<2>({90, 80});
  const Lattice<3> block = unit_lattice<3>({40, 36, 12}), slices = unit_lattice<3>({60, 50, 2});
  for (double noise : {0.5, 4.0}) {
    EXPECT_NEAR(sd_of<2>(plane, scene<2, float>(plane, noise, false)), noise, 0.05 * noise);
    EXPECT_NEAR(sd_of<2>(plane, scene<2, double>(plane, noise, true)), noise, 0.07 * noise);
    EXPECT_NEAR(sd_of<3>(block, scene<3, float>(block, noise, true)), noise, 0.07 * noise);
    EXPECT_NEAR(sd_of<3>(slices, scene<3, float>(slices, noise, false)), noise, 0.07 * noise);
  }
}

TEST(NoiseSd, FindsNoneInWhatHasNone) {
  const Lattice<2> plane = unit_lattice<2>({60, 50});
  EXPECT_LT(sd_of<2>(plane, scene<2, double>(plane, 0, false)), 0.01);  // of a range of 140
  EXPECT_EQ(sd_of<2>(plane, std::vector<float>(plane.sites(), 7.0f)), 0);
  const Lattice<2> tiny = unit_lattice<2>({2, 2});
  EXPECT_EQ(sd_of<2>(tiny, std::vector<float>{1, 5, 2, 9}), 0);
}

TEST(NoiseSd, DoesNotLookBehindMasks) {
  const Lattice<2> plane = unit_lattice<2>({90, 80});
  std::vector<float> samples = scene<2, float>(plane, 0.5, false), weights(plane.sites(), 1.0f);
  const std::vector<float> loud = scene<2, float>(plane, 50, false);
  for (std::size_t i = 0; i < weights.size() * 3 / 4; ++i) {
    weights[i] = 0;
    samples[i] = loud[i];
  }
  EXPECT_NEAR(noise_sd<2>(plane, samples.data(), weights.data()), 0.5, 0.05);
  for (std::size_t i = 0; i < weights.size() * 3 / 4; ++i) samples[i] = std::nanf("");
  EXPECT_NEAR(noise_sd<2>(plane, samples.data(), weights.data()), 0.5, 0.05);
  std::fill(weights.begin(), weights.end(), 0.0f);
  EXPECT_EQ(noise_sd<2>(plane, samples.data(), weights.data()), 0);
}

TEST(SmoothingAgainstNoise, LosesNoMoreThanItMayAndSmoothsNoMoreThanItMust) {
  EXPECT_EQ(smoothing_against_noise(0, 2, 0.01), 0);
  EXPECT_EQ(smoothing_against_noise(0.0141, 2, 0.01), 0);  // half of the variance is lost without smoothing
  EXPECT_GT(smoothing_against_noise(0.0143, 2, 0.01), 0);
  EXPECT_NEAR(smoothing_against_noise(10, 2, 0.01), 2, 1e-6);
  // Brute force: smooth white noise, compare its variance at samples and half way along x.
  const double noise = 0.05, tolerance = 0.01, sigma = smoothing_against_noise(noise, 2, tolerance);
  constexpr int n = 400;
  std::mt19937 random(3);
  std::normal_distribution<double> normal(0, noise);
  std::vector<double> image(n * n), next(n * n);
  for (double& v : image) v = normal(random);
  for (std::size_t stride : {1, n}) {
    for (int y = 0; y < n; ++y)
      for (int x = 0; x < n; ++x) {
        double sum = 0, total = 0;
        for (int j = -6; j <= 6; ++j) {
          const int at = stride == 1 ? y * n + (x + j + n) % n : (y + j + n) % n * n + x;
          const double w = std::exp(-0.5 * j * j / (sigma * sigma));
          sum += w * image[at];
          total += w;
        }
        next[y * n + x] = sum / total;
      }
    std::swap(image, next);
  }
  double at_sample = 0, half_way = 0;
  for (int y = 0; y < n; ++y)
    for (int x = 0; x < n; ++x) {
      const double here = image[y * n + x], beside = image[y * n + (x + 1) % n];
      at_sample += here * here;
      half_way += (here + beside) * (here + beside) / 4;
    }
  EXPECT_NEAR((at_sample - half_way) / (n * n), tolerance * tolerance, 0.05 * tolerance * tolerance);
}

}  // namespace
}  // namespace saltus
