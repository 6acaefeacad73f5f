#include "core/drawing/raster.h"

#include <png.h>
#include <zlib.h>

#include <algorithm>
#include <csetjmp>
#include <stdexcept>

namespace saltus::drawing {

namespace {

struct Pixels {
  int width, height, channels;
  const std::uint8_t* bytes;
};

[[noreturn]] void on_error(png_structp png, png_const_charp message) {
  *static_cast<std::string*>(png_get_error_ptr(png)) = message;
  png_longjmp(png, 1);
}
void on_warning(png_structp, png_const_charp) {}

void append(png_structp png, png_bytep bytes, std::size_t count) {
  static_cast<std::string*>(png_get_io_ptr(png))->append(reinterpret_cast<const char*>(bytes), count);
}
void flush(png_structp) {}

/// False after an error. By itself, as libpng's errors jump out of it: nothing here may need a destructor.
bool write(png_structp png, png_infop info, const Pixels& pixels) {
  if (setjmp(png_jmpbuf(png))) return false;
  const auto size = static_cast<png_uint_32>(pixels.width);
  png_set_IHDR(png, info, size, static_cast<png_uint_32>(pixels.height), 8,
               pixels.channels == 3 ? PNG_COLOR_TYPE_RGB : PNG_COLOR_TYPE_GRAY, PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  // Slices of images repeat nothing but runs once their neighbours are taken off, so that a search for other
  // repetitions takes six times as long for nothing.
  png_set_filter(png, PNG_FILTER_TYPE_BASE, PNG_FILTER_PAETH);
  png_set_compression_strategy(png, Z_RLE);
  png_write_info(png, info);
  for (int row = 0; row < pixels.height; ++row)
    png_write_row(png, pixels.bytes + static_cast<std::size_t>(row) * pixels.width * pixels.channels);
  png_write_end(png, info);
  return true;
}

std::string encode(const Pixels& pixels) {
  std::string file, message;
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, &message, on_error, on_warning);
  png_infop info = png ? png_create_info_struct(png) : nullptr;
  if (info) png_set_write_fn(png, &file, append, flush);
  const bool is_written = info && write(png, info, pixels);
  png_destroy_write_struct(&png, &info);
  if (!is_written) throw std::runtime_error("a picture cannot be encoded: " + message);
  return file;
}

}  // namespace

std::string encode_png(const Raster& raster) {
  const bool is_grey = std::all_of(raster.pixels.begin(), raster.pixels.end(),
                                   [](const Colour& pixel) { return pixel[0] == pixel[1] && pixel[0] == pixel[2]; });
  if (!is_grey) return encode({raster.width, raster.height, 3, raster.pixels.data()->data()});
  GreyRaster grey(raster.width, raster.height);
  std::transform(raster.pixels.begin(), raster.pixels.end(), grey.pixels.begin(),
                 [](const Colour& pixel) { return pixel[0]; });
  return encode_png(grey);
}

std::string encode_png(const GreyRaster& raster) {
  return encode({raster.width, raster.height, 1, raster.pixels.data()});
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
