#include "core/grid/intensity_range.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace saltus {
namespace {

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
