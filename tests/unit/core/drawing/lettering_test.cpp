#include "core/drawing/lettering.h"

#include <gtest/gtest.h>

#include <set>

namespace saltus::drawing {
namespace {

Raster written(std::string_view text, TextAnchor anchor, bool upwards = false) {
  Raster raster(200, 200);
  raster.pixels.assign(raster.pixels.size(), {255, 255, 255});
  const TextStyle style{.height = 12, .colour = {0, 0, 0}, .anchor = anchor};
  upwards ? write_upwards(raster, text, {100, 100}, style) : write(raster, text, {100, 100}, style);
  return raster;
}

struct Box {
  int left = 200, right = -1, top = 200, bottom = -1;
};
Box dark_box(const Raster& raster) {
  Box box;
  for (int row = 0; row < raster.height; ++row)
    for (int column = 0; column < raster.width; ++column)
      if (raster.at(column, row)[0] < 128)
        box = {std::min(box.left, column), std::max(box.right, column), std::min(box.top, row),
               std::max(box.bottom, row)};
  return box;
}

TEST(Lettering, EveryLetterLooksDifferent) {
  std::set<std::vector<Colour>> pictures;
  for (int code = 33; code < 127; ++code)
    EXPECT_TRUE(pictures.insert(written(std::string(1, static_cast<char>(code)), TextAnchor::Start).pixels).second)
        << static_cast<char>(code);
  EXPECT_EQ(written("\x01", TextAnchor::Start).pixels, written("?", TextAnchor::Start).pixels);
}

TEST(Lettering, StandsOnItsBaselineAtItsAnchor) {
  const double width = text_width("HEH", 12);
  const Box start = dark_box(written("HEH", TextAnchor::Start));
  EXPECT_NEAR(start.left, 100, 1.5);
  EXPECT_NEAR(start.right, 100 + width, 1.5);
  EXPECT_NEAR(start.bottom, 100, 1.5);
  EXPECT_NEAR(start.top, 88, 1.5);
  EXPECT_NEAR(dark_box(written("HEH", TextAnchor::Middle)).left, 100 - width / 2, 1.5);
  EXPECT_NEAR(dark_box(written("HEH", TextAnchor::End)).right, 100, 1.5);
}

TEST(Lettering, GoesUpwards) {
  const Box box = dark_box(written("HEH", TextAnchor::Start, true));
  EXPECT_NEAR(box.bottom, 100, 1.5);
  EXPECT_NEAR(box.top, 100 - text_width("HEH", 12), 1.5);
  EXPECT_NEAR(box.right, 100, 1.5);
}

}  // namespace
}  // namespace saltus::drawing
