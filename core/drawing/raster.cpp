#include "core/drawing/raster.h"

#include <png.h>

#include <stdexcept>

namespace saltus::drawing {

namespace {

std::string encode(int width, int height, png_uint_32 format, const void* pixels) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  image.width = static_cast<png_uint_32>(width);
  image.height = static_cast<png_uint_32>(height);
  image.format = format;
  // The first call only tells the size; libpng allows guessing an upper bound, but then compresses twice as well.
  png_alloc_size_t bytes = PNG_IMAGE_PNG_SIZE_MAX(image);
  std::string file(bytes, '\0');
  if (!png_image_write_to_memory(&image, file.data(), &bytes, 0, pixels, 0, nullptr))
    throw std::runtime_error(std::string("a picture cannot be encoded: ") + image.message);
  file.resize(bytes);
  return file;
}

}  // namespace

std::string encode_png(const Raster& raster) {
  return encode(raster.width, raster.height, PNG_FORMAT_RGB, raster.pixels.data());
}

std::string encode_png(const GreyRaster& raster) {
  return encode(raster.width, raster.height, PNG_FORMAT_GRAY, raster.pixels.data());
}

std::string base64(std::string_view bytes) {
  constexpr std::string_view digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t group = 0;
    for (std::size_t k = 0; k < 3; ++k)
      group = group << 8 | (i + k < bytes.size() ? static_cast<std::uint8_t>(bytes[i + k]) : 0u);
    for (std::size_t k = 0; k < 4; ++k) text += i + k <= bytes.size() ? digits[group >> (18 - 6 * k) & 63] : '=';
  }
  return text;
}

std::string data_uri(const Raster& raster) { return "data:image/png;base64," + base64(encode_png(raster)); }
std::string data_uri(const GreyRaster& raster) { return "data:image/png;base64," + base64(encode_png(raster)); }

}  // namespace saltus::drawing
