#pragma once

#include <filesystem>

#include "core/grid/volume.h"

namespace saltus {

/// Writes an ITK composite transform (HDF5) with one displacement field transform, which maps fixed world points to
/// moving world points: x + u(x), `displacement` interpolated linearly. ITK, and what is built on it, takes points
/// outside the grid as not displaced. Stored in single precision like the field, so the file maps as the field does.
///
/// `path` must end in .h5 and is replaced at once. Throws InvalidInput for another suffix or a field that does not fit
/// its grid, FileError when writing fails.
template <int Dim>
void write_transform(const std::filesystem::path& path, const VectorVolume<Dim>& displacement);

}  // namespace saltus
