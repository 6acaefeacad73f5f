#pragma once

#include <filesystem>
#include <vector>

#include "core/grid/image_grid.h"

namespace saltus {

/// Landmarks are CSV text: the header `x,y,z` (2-D: `x,y`), then one point a line, world millimetres (LPS).

/// Reads landmarks in the order of the file. Empty lines and a byte order mark are skipped. A 2-D read takes an x,y,z
/// file when every z is 0. Throws FileError that names file, line and reason when the file is missing, has another
/// header, no point, a wrong number of fields, or a field that is not a finite number.
template <int Dim>
std::vector<Vector<Dim>> read_points(const std::filesystem::path& path);

/// Writes landmarks so that reading gives the same numbers. Replaces `path` at once. Throws InvalidInput when a
/// coordinate is not finite, FileError when writing fails.
template <int Dim>
void write_points(const std::filesystem::path& path, const std::vector<Vector<Dim>>& points);

}  // namespace saltus
