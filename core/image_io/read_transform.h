#pragma once

#include <filesystem>

#include "core/grid/volume.h"

namespace saltus {

/// Reads a displacement field from where one can be: an ITK transform file (.h5) as write_transform makes it, or a
/// vector image of any format that read_vector_volume knows. World mm, LPS.
///
/// An ITK transform file must hold one displacement field transform, alone or as the only part of a composite, in
/// single or double precision; its samples become single. Both functions throw InvalidInput for a suffix that is not
/// known, and FileError, naming the file and the reason, when it is missing, damaged, of another dimension, or holds
/// anything else. Samples that are not finite are passed on. Direction cosines are treated as read_image.h says.
template <int Dim>
VectorVolume<Dim> read_displacement(const std::filesystem::path& path);

/// 2 or 3.
int displacement_dimension(const std::filesystem::path& path);

}  // namespace saltus
