#include "core/drawing/raster.h"
#include "core/drawing/colour_map.h"

#include <gtest/gtest.h>
#include <png.h>

#include <cmath>
#include <random>

namespace saltus::drawing {
namespace {

/// Oracle: libpng's reader.
Raster decode(const std::string& file) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  if (!png_image_begin_read_from_memory(&image, file.data(), file.size())) throw std::runtime_error(image.message);
  image.format = PNG_FORMAT_RGB;
  Raster raster(static_cast<int>(image.width), static_cast<int>(image.height));
  if (!png_image_finish_read(&image, nullptr, raster.pixels.data(), 0, nullptr))
    throw std::runtime_error(image.message);
  return raster;
}

TEST(EncodePng, GivesEveryPixelBack) {
  std::mt19937 random(7);
  for (const auto& [width, height] : {std::pair{1, 1}, {5, 3}, {64, 1}, {33, 70}}) {
    Raster raster(width, height);
    for (Colour& pixel : raster.pixels)
      for (std::uint8_t& channel : pixel) channel = static_cast<std::uint8_t>(random());
    const Raster read = decode(encode_png(raster));
    EXPECT_EQ(read.width, width);
    EXPECT_EQ(read.height, height);
    EXPECT_EQ(read.pixels, raster.pixels);
  }
}

TEST(EncodePng, NeedsOneChannelForWhatHasNoColour) {
  std::mt19937 random(7);
  Raster raster(33, 70);
  for (Colour& pixel : raster.pixels) pixel.fill(static_cast<std::uint8_t>(random()));
  const std::string grey = encode_png(raster);
  EXPECT_EQ(decode(grey).pixels, raster.pixels);
  EXPECT_LT(grey.size(), 33u * 70 + 300);  // noise has a byte of content a channel
  raster.at(32, 69) = {1, 2, 3};
  EXPECT_EQ(decode(encode_png(raster)).pixels, raster.pixels);
}

TEST(Base64, FollowsRfc4648) {  // its section 10
  EXPECT_EQ(base64(""), "");
  EXPECT_EQ(base64("f"), "Zg==");
  EXPECT_EQ(base64("fo"), "Zm8=");
  EXPECT_EQ(base64("foo"), "Zm9v");
  EXPECT_EQ(base64("foob"), "Zm9vYg==");
  EXPECT_EQ(base64("foobar"), "Zm9vYmFy");
  EXPECT_EQ(base64("\xff\xfe\xfd"), "//79");
}

TEST(ColourMap, IsClippedAndGreyForWhatIsNoNumber) {
  EXPECT_EQ(sequential(-3), sequential(0));
  EXPECT_EQ(sequential(3), sequential(1));
  EXPECT_EQ(diverging(-3), diverging(-1));
  EXPECT_EQ(grey(0), (Colour{0, 0, 0}));
  EXPECT_EQ(grey(1), (Colour{255, 255, 255}));
  EXPECT_EQ(heat(std::nan("")), (Colour{128, 128, 128}));
}

TEST(ColourMap, DivergesFromBlueToRedAroundWhite) {
  EXPECT_GT(diverging(-0.6)[2], diverging(-0.6)[0] + 50);
  EXPECT_GT(diverging(0.6)[0], diverging(0.6)[2] + 50);
  for (std::uint8_t channel : diverging(0)) EXPECT_GT(channel, 240);
}

}  // namespace
}  // namespace saltus::drawing
