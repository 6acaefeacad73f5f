#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace saltus::drawing {

/// Red, green, blue.
using Colour = std::array<std::uint8_t, 3>;

/// Picture in memory: rows from the top, pixels from the left.
struct Raster {
  int width = 0;
  int height = 0;
  std::vector<Colour> pixels;

  Raster() = default;
  Raster(int columns, int rows) : width(columns), height(rows), pixels(static_cast<std::size_t>(columns) * rows) {}
  Colour& at(int column, int row) { return pixels[static_cast<std::size_t>(row) * width + column]; }
  const Colour& at(int column, int row) const { return pixels[static_cast<std::size_t>(row) * width + column]; }
};

/// The same with one grey value a pixel.
struct GreyRaster {
  int width = 0;
  int height = 0;
  std::vector<std::uint8_t> pixels;

  GreyRaster(int columns, int rows) : width(columns), height(rows), pixels(static_cast<std::size_t>(columns) * rows) {}
  std::uint8_t& at(int column, int row) { return pixels[static_cast<std::size_t>(row) * width + column]; }
};

/// The bytes of a PNG file, 8 bits a channel; one channel where nothing has a colour.
std::string encode_png(const Raster& raster);
std::string encode_png(const GreyRaster& raster);

std::string base64(std::string_view bytes);

/// "data:image/png;base64,...", what an <img> shows without loading a file.
std::string data_uri(const Raster& raster);
std::string data_uri(const GreyRaster& raster);

}  // namespace saltus::drawing
