#include "core/drawing/strokes.h"

#include <gtest/gtest.h>

#include <limits>

namespace saltus::drawing {
namespace {

Raster white(int width, int height) {
  Raster raster(width, height);
  raster.pixels.assign(raster.pixels.size(), {255, 255, 255});
  return raster;
}

/// Darkness summed over a picture, in black pixels.
double ink(const Raster& raster) {
  double sum = 0;
  for (const Colour& pixel : raster.pixels) sum += 1 - pixel[1] / 255.0;
  return sum;
}

TEST(Draw, CoversTheAreaOfALine) {
  // Along the pixels' rows and across them: length times width, and half a disc at each end.
  for (const Vector<2>& end : {Vector<2>(50.5, 10.5), Vector<2>(40.3, 37.1)}) {
    Raster raster = white(60, 50);
    const Vector<2> start(10.5, 10.5);
    draw(raster, {{start, end}}, {.colour = {0, 0, 0}, .width = 3});
    const double area = 3 * (end - start).norm() + 3.14159 * 1.5 * 1.5;
    EXPECT_NEAR(ink(raster), area, 0.03 * area);
  }
}

TEST(Draw, IsBlackInTheMiddleAndLeavesTheRest) {
  Raster raster = white(20, 9);
  draw(raster, {{{2, 4.5}, {18, 4.5}}}, {.width = 1});
  EXPECT_EQ(raster.at(10, 4), (Colour{0, 0, 0}));
  EXPECT_EQ(raster.at(10, 2), (Colour{255, 255, 255}));
  EXPECT_EQ(raster.at(10, 6), (Colour{255, 255, 255}));
}

TEST(Draw, DoesNotDarkenCrossings) {
  Raster raster = white(21, 21);
  draw(raster, {{{0, 10.5}, {21, 10.5}}, {{10.5, 0}, {10.5, 21}}}, {.width = 1, .opacity = 0.5});
  EXPECT_EQ(raster.at(10, 10), raster.at(3, 10));
  EXPECT_NEAR(raster.at(10, 10)[0], 128, 1);
}

TEST(Draw, LeavesOutWhatLiesBeyondAndBreaksAtWhatIsNoNumber) {
  Raster raster = white(20, 20);
  const double none = std::numeric_limits<double>::quiet_NaN();
  draw(raster, {{{-50, -50}, {-40, -1}}, {{1, 10}, {none, 10}, {19, 10}}, {{5, 5}}, {}}, {});
  EXPECT_EQ(ink(raster), 0);
}

}  // namespace
}  // namespace saltus::drawing
