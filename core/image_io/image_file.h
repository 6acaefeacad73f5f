#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <span>
#include <vector>

#include "core/image_io/image_format.h"

namespace saltus {

/// The header of an image file, of either dimension. Entries beyond `dimension` have no meaning.
struct ImageFileHeader {
  int dimension = 0;
  int components = 1;  ///< values a voxel, next to each other in the file
  std::array<std::size_t, 3> size{};
  std::array<double, 3> spacing{};
  std::array<double, 3> origin{};                    ///< LPS mm
  std::array<std::array<double, 3>, 3> direction{};  ///< [j] is the world direction of grid axis j
};

struct ImageFile {
  ImageFileHeader header;
  std::vector<float> samples;  ///< component fastest, then x
};

/// Colour files give one component, luminance. The checks and errors are those of read_image.h, except for what depends
/// on the dimension or the number of components that the caller needs.
ImageFileHeader read_image_header(const std::filesystem::path& path);
ImageFile read_image_file(const std::filesystem::path& path);

/// Throw FileError, and InvalidInput for sizes that NIfTI has no room for. `samples` has x fastest and the component
/// slowest. All but PNG are written from where the samples are, without a copy of them. May be called by several
/// threads at once.
void write_image_file(const std::filesystem::path& path, const ImageFileHeader& header, std::span<const float> samples);
void write_image_file(const std::filesystem::path& path, const ImageFileHeader& header,
                      std::span<const std::uint8_t> samples);

}  // namespace saltus
