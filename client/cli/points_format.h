#pragma once

#include "core/grid/image_grid.h"

#include <filesystem>
#include <string>
#include <vector>

namespace CLI {
class App;
}

namespace saltus::cli {

/// How the numbers in a landmark file are meant.
struct PointsFormat {
  std::string space = "lps";  ///< or "ras": x and y run the other way
  std::string unit = "mm";    ///< or "voxel": continuous indices from 0, in the image that the points belong to

  bool is_default() const { return space == "lps" && unit == "mm"; }
};

/// Adds --points-space and --points-unit.
void add_points_format_options(CLI::App& app, PointsFormat& format);

/// Throws InvalidInput for a name that does not exist, and for voxels in a space, which have none.
void require_valid(const PointsFormat& format);

/// Reads landmarks of an image with this grid and gives them as world mm (LPS).
template <int Dim>
std::vector<Vector<Dim>> read_points_as(const PointsFormat& format, const std::filesystem::path& file,
                                        const ImageGrid<Dim>& grid);

/// World mm (LPS) in the format's space; the unit is mm.
template <int Dim>
std::vector<Vector<Dim>> in_space_of(const PointsFormat& format, std::vector<Vector<Dim>> points);

}  // namespace saltus::cli
