#include "core/image_io/write_image.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "core/image_io/image_file.h"
#include "core/support/errors.h"

namespace saltus {
namespace {

/// Throws InvalidInput when `samples` does not fit `grid`, or `grid` the format.
template <int Dim>
ImageFileHeader header_of(const std::filesystem::path& path, const ImageGrid<Dim>& grid, std::size_t samples,
                          int components) {
  const std::string name = path.filename().string();
  if (const auto found = problems(grid); !found.empty())
    throw InvalidInput("image for " + name + " cannot be written: " + found.front());
  if (samples != grid.voxels() * components)
    throw InvalidInput("image for " + name + " has " + std::to_string(samples) + " samples; its grid needs " +
                       std::to_string(grid.voxels() * components));
  if (format_from_suffix(path) == ImageFormat::Png && (Dim != 2 || components != 1))
    throw InvalidInput("file name " + name + " asks for PNG, which holds 2-D scalar images only; use .mha or .nii.gz");
  ImageFileHeader header;
  header.dimension = Dim;
  header.components = components;
  for (int axis = 0; axis < Dim; ++axis) {
    header.size[axis] = grid.size[axis];
    header.spacing[axis] = grid.spacing[axis];
    header.origin[axis] = grid.origin[axis];
    for (int row = 0; row < Dim; ++row) header.direction[axis][row] = grid.direction(row, axis);
  }
  return header;
}

template <int Dim>
std::vector<std::uint8_t> to_grey(const Volume<Dim>& image, GreyRange range) {
  if (!std::isfinite(range.black) || !std::isfinite(range.white) || range.black > range.white)
    throw InvalidInput("grey range is " + std::to_string(range.black) + " to " + std::to_string(range.white) +
                       "; both must be finite and the first not larger");
  const double width = static_cast<double>(range.white) - range.black;
  std::vector<std::uint8_t> grey(image.samples.size());
  std::transform(image.samples.begin(), image.samples.end(), grey.begin(), [=](float sample) {
    // A constant image (0 / 0) is black, like what is not a number.
    const double value = (static_cast<double>(sample) - range.black) * 255.0 / width;
    return value > 0 ? static_cast<std::uint8_t>(std::lround(std::min(value, 255.0))) : std::uint8_t{0};
  });
  return grey;
}

}  // namespace

template <int Dim>
void write_volume(const std::filesystem::path& path, const Volume<Dim>& image, const std::optional<GreyRange>& range) {
  const ImageFileHeader header = header_of(path, image.grid, image.samples.size(), 1);
  if (format_from_suffix(path) != ImageFormat::Png) {
    write_image_file(path, header, std::span<const float>(image.samples));
    return;
  }
  const auto [low, high] = std::minmax_element(image.samples.begin(), image.samples.end());
  const std::vector<std::uint8_t> grey = to_grey(image, range.value_or(GreyRange{*low, *high}));
  write_image_file(path, header, std::span<const std::uint8_t>(grey));
}

template <int Dim>
void write_labels(const std::filesystem::path& path, const Volume<Dim>& labels) {
  const ImageFileHeader header = header_of(path, labels.grid, labels.samples.size(), 1);
  std::vector<std::uint8_t> bytes(labels.samples.size());
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    const float label = labels.samples[i];
    if (!(label >= 0 && label <= 255) || label != std::floor(label))
      throw InvalidInput("labels for " + path.filename().string() + " contain " + std::to_string(label) +
                         "; a label is an integer from 0 to 255");
    bytes[i] = static_cast<std::uint8_t>(label);
  }
  write_image_file(path, header, std::span<const std::uint8_t>(bytes));
}

template <int Dim>
void write_vector_volume(const std::filesystem::path& path, const VectorVolume<Dim>& vectors) {
  const ImageFileHeader header = header_of(path, vectors.grid, vectors.samples.size(), Dim);
  write_image_file(path, header, std::span<const float>(vectors.samples));
}

template void write_volume(const std::filesystem::path&, const Volume<2>&, const std::optional<GreyRange>&);
template void write_volume(const std::filesystem::path&, const Volume<3>&, const std::optional<GreyRange>&);
template void write_labels(const std::filesystem::path&, const Volume<2>&);
template void write_labels(const std::filesystem::path&, const Volume<3>&);
template void write_vector_volume(const std::filesystem::path&, const VectorVolume<2>&);
template void write_vector_volume(const std::filesystem::path&, const VectorVolume<3>&);

}  // namespace saltus
