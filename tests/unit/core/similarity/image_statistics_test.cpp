#include "core/similarity/image_statistics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tests/support/random_fields.h"

namespace saltus {
namespace {

/// Normal values by Box and Muller.
std::vector<double> normal_values(std::size_t count, double deviation) {
  testing::Random random(4);
  std::vector<double> values(count);
  for (double& value : values) {
    const double u = 0.5 * (random.symmetric() + 1), v = random.symmetric();
    value = deviation * std::sqrt(-2 * std::log(1 - u)) * std::cos(std::numbers::pi * v);
  }
  return values;
}

TEST(NoiseDeviation, IsThatOfTheNoiseWhateverTheScene) {
  const Lattice<3> lattice{{40, 30, 20}, {1, 1, 3}, {}};
  const std::vector<double> noise = normal_values(lattice.sites(), 0.05), scene = testing::random_waves<3>(lattice, 1);
  std::vector<double> image = noise;
  EXPECT_NEAR(noise_deviation<3>(lattice, image.data(), static_cast<double*>(nullptr)), 0.05, 0.002);
  for (std::size_t i = 0; i < image.size(); ++i) image[i] = 100 + scene[i] + (i / 600 % 2 ? 3 : 0) + noise[i];
  EXPECT_NEAR(noise_deviation<3>(lattice, image.data(), static_cast<double*>(nullptr)), 0.05, 0.004);
  EXPECT_LT(noise_deviation<3>(lattice, scene.data(), static_cast<double*>(nullptr)), 0.01);
}

TEST(NoiseDeviation, TakesThinImagesAndMasks) {
  const Lattice<3> slice{{60, 50, 1}, {1, 1, 1}, {}}, pair{{2, 2, 2}, {1, 1, 1}, {}};
  std::vector<double> image = normal_values(slice.sites(), 0.05), mask(image.size(), 1.0);
  EXPECT_NEAR(noise_deviation<3>(slice, image.data(), mask.data()), 0.05, 0.003);
  for (std::size_t i = 0; i < image.size() / 2; ++i) {
    image[i] = i % 2 ? std::nan("") : 1e9;
    mask[i] = 0;
  }
  EXPECT_NEAR(noise_deviation<3>(slice, image.data(), mask.data()), 0.05, 0.005);
  std::fill(mask.begin(), mask.end(), 0.0);
  EXPECT_EQ(noise_deviation<3>(slice, image.data(), mask.data()), 0);
  EXPECT_EQ(noise_deviation<3>(pair, image.data() + 2000, static_cast<double*>(nullptr)), 0);
}

TEST(IntensityRange, IsThePercentilesOfWhatIsSeen) {
  std::vector<double> image(1001), mask(1001, 1.0);
  for (std::size_t i = 0; i < image.size(); ++i) image[i] = static_cast<double>(i * 8 % 1001);
  IntensityRange range = intensity_range<double>(image.size(), image.data(), nullptr);
  EXPECT_EQ(range.low, 10);
  EXPECT_EQ(range.high, 990);
  for (std::size_t i = 0; i < image.size(); ++i)
    if (image[i] > 500) mask[i] = 0, image[i] = std::nan("");
  range = intensity_range(image.size(), image.data(), mask.data());
  EXPECT_EQ(range.low, 5);
  EXPECT_EQ(range.high, 495);
}

TEST(IntensityRange, IsAllThatThereIsWhenThePercentilesCoincide) {
  std::vector<double> image(1000, 2.0);
  EXPECT_EQ(intensity_range<double>(image.size(), image.data(), nullptr).width(), 0);
  image[500] = 3;
  const IntensityRange range = intensity_range<double>(image.size(), image.data(), nullptr);
  EXPECT_EQ(range.low, 2);
  EXPECT_EQ(range.high, 3);
  const std::vector<double> nothing(1000, 0.0);
  EXPECT_EQ(intensity_range(image.size(), image.data(), nothing.data()).width(), 0);
}

}  // namespace
}  // namespace saltus
