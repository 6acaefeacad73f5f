#include "core/grid/intensity_window.h"

#include <gmock/gmock.h>

#include <limits>

#include "core/support/errors.h"

namespace saltus {
namespace {

Volume<2> example() {
  ImageGrid<2> grid;
  grid.size = {5, 1};
  grid.spacing = {2, 3};
  Volume<2> image(grid);
  image.samples = {-1000, -5, 0, 7.5f, 3000};
  return image;
}

TEST(ClipIntensities, ClampsAndKeepsTheGrid) {
  const auto clipped = clip_intensities(example(), -5.0f, 7.0f);
  EXPECT_THAT(clipped.samples, ::testing::ElementsAre(-5, -5, 0, 7, 7));
  EXPECT_EQ(clipped.grid, example().grid);
}

TEST(ClipIntensities, RefusesAWindowWithoutWidth) {
  constexpr float infinity = std::numeric_limits<float>::infinity();
  EXPECT_THROW(clip_intensities(example(), 3.0f, 3.0f), InvalidInput);
  EXPECT_THROW(clip_intensities(example(), 4.0f, 3.0f), InvalidInput);
  EXPECT_THROW(clip_intensities(example(), 0.0f, infinity), InvalidInput);
  EXPECT_THROW(clip_intensities(example(), std::nanf(""), 3.0f), InvalidInput);
}

}  // namespace
}  // namespace saltus
