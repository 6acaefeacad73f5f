#include "client/cli/points_format.h"

#include "core/image_io/points_io.h"
#include "core/support/errors.h"

#include <CLI/CLI.hpp>

namespace saltus::cli {

void add_points_format_options(CLI::App& app, PointsFormat& format) {
  app.add_option("--points-space", format.space, "World axes of the landmarks: lps (ITK, DICOM) or ras (NIfTI, Slicer)")
      ->capture_default_str();
  app.add_option("--points-unit", format.unit, "mm, or voxel: indices from 0 in the image that the points belong to")
      ->capture_default_str();
}

void require_valid(const PointsFormat& format) {
  if (format.space != "lps" && format.space != "ras")
    throw InvalidInput("--points-space is " + format.space + "; it must be lps or ras");
  if (format.unit != "mm" && format.unit != "voxel")
    throw InvalidInput("--points-unit is " + format.unit + "; it must be mm or voxel");
  if (format.unit == "voxel" && format.space != "lps")
    throw InvalidInput("--points-unit is voxel and --points-space is " + format.space +
                       "; voxel indices have no world axes, so leave --points-space out");
}

template <int Dim>
std::vector<Vector<Dim>> in_space_of(const PointsFormat& format, std::vector<Vector<Dim>> points) {
  if (format.space == "ras")
    for (Vector<Dim>& point : points) point.template head<2>() *= -1;
  return points;
}

template <int Dim>
std::vector<Vector<Dim>> read_points_as(const PointsFormat& format, const std::filesystem::path& file,
                                        const ImageGrid<Dim>& grid) {
  require_valid(format);
  std::vector<Vector<Dim>> points = in_space_of(format, read_points<Dim>(file));
  if (format.unit == "voxel")
    for (Vector<Dim>& point : points) point = grid.to_world(point);
  return points;
}

#define SALTUS_POINTS_FORMAT(DIM)                                                                     \
  template std::vector<Vector<DIM>> in_space_of(const PointsFormat&, std::vector<Vector<DIM>>);       \
  template std::vector<Vector<DIM>> read_points_as(const PointsFormat&, const std::filesystem::path&, \
                                                   const ImageGrid<DIM>&);
SALTUS_POINTS_FORMAT(2)
SALTUS_POINTS_FORMAT(3)
#undef SALTUS_POINTS_FORMAT

}  // namespace saltus::cli
