#pragma once

#include <filesystem>
#include <optional>

#include "core/grid/volume.h"
#include "core/image_io/image_format.h"

namespace saltus {

/// All functions write beside the target and then rename, so that `path` holds the old file or the whole new one. They
/// throw InvalidInput for an unknown suffix or a volume that the format cannot hold, and FileError, naming the file,
/// when writing fails. What is written reads back with the same samples and grid; NIfTI stores the grid in single
/// precision. Only .nii.gz is compressed (output_stream.h). Beside the volume, writing takes as much memory again for
/// vectors in other formats than NIfTI, and for NIfTI next to none.

/// Values of the image that become black and white in a format of eight bits.
struct GreyRange {
  float black = 0;
  float white = 255;
};

/// Writes floats; for .png (2-D only) eight bits, rounded and clipped, `range` (default: minimum and maximum of the
/// image) mapped to 0 and 255. A .png keeps no origin and no direction.
template <int Dim>
void write_volume(const std::filesystem::path& path, const Volume<Dim>& image,
                  const std::optional<GreyRange>& range = {});

/// Writes a mask or label map in eight bits without scaling. Throws InvalidInput when a sample is not an integer in
/// 0..255.
template <int Dim>
void write_labels(const std::filesystem::path& path, const Volume<Dim>& labels);

/// Writes a displacement field as ITK reads it: Dim floats a voxel, LPS world millimetres, components as they are.
/// NIfTI marks them with the intent "vector". Throws InvalidInput for .png.
template <int Dim>
void write_vector_volume(const std::filesystem::path& path, const VectorVolume<Dim>& vectors);

}  // namespace saltus
