#include "core/drawing/sheet.h"

#include "core/drawing/colour_map.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace saltus::drawing {
namespace {

Raster plain(int width, int height, Colour colour) {
  Raster raster(width, height);
  raster.pixels.assign(raster.pixels.size(), colour);
  return raster;
}

std::ptrdiff_t count(const Raster& raster, Colour colour) {
  return std::count(raster.pixels.begin(), raster.pixels.end(), colour);
}

TEST(Sheet, HoldsEveryPictureWholeInItsPlace) {
  const Colour red{250, 1, 2}, green{3, 251, 4}, blue{5, 6, 252};
  const Raster whole = sheet(
      {{{"", plain(40, 30, red), {}}, {"", plain(50, 20, green), {}}}, {{"", {}, {}}, {"", plain(60, 10, blue), {}}}});
  EXPECT_EQ(count(whole, red), 40 * 30);
  EXPECT_EQ(count(whole, green), 50 * 20);
  EXPECT_EQ(count(whole, blue), 60 * 10);
  const auto first = [&](Colour colour) {
    return std::find(whole.pixels.begin(), whole.pixels.end(), colour) - whole.pixels.begin();
  };
  // Below each other in one column; side by side in one row.
  EXPECT_EQ(first(green) % whole.width, first(blue) % whole.width);
  EXPECT_EQ(first(red) / whole.width, first(green) / whole.width);
  EXPECT_GT(first(green) % whole.width, first(red) % whole.width + 40);
}

TEST(Sheet, ShowsTheColoursOfAScale) {
  const ColourScale scale{grey, {"0", "1", "2"}, "mm"};
  const Raster with = sheet({{{"", plain(256, 10, {1, 200, 3}), scale}}});
  for (int i = 0; i < 256; ++i) EXPECT_GE(count(with, grey(i / 255.0)), 9) << i;
}

TEST(Magnified, MakesSquares) {
  Raster small(2, 1);
  small.at(1, 0) = {9, 8, 7};
  const Raster large = magnified(small, 3);
  EXPECT_EQ(large.width, 6);
  EXPECT_EQ(large.height, 3);
  EXPECT_EQ(large.at(2, 2), (Colour{0, 0, 0}));
  EXPECT_EQ(large.at(3, 0), (Colour{9, 8, 7}));
}

}  // namespace
}  // namespace saltus::drawing
