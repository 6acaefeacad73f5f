#include "server/worker/report/deformed_grid.h"

#include "server/worker/report/field_sampling.h"

#include <algorithm>
#include <cstdio>

namespace saltus::report {
namespace {

constexpr int lines_along_longest_side = 24;
constexpr int points_along_longest_side = 192;

}  // namespace

template <int Dim>
std::string deformed_grid_path(const VectorVolume<Dim>& displacement, const SlicePlane<Dim>& plane) {
  const ImageGrid<Dim>& grid = displacement.grid;
  const double longest = std::max(plane.width, plane.height);
  const double distance = longest / lines_along_longest_side;
  const double step = std::max(1.0, longest / points_along_longest_side);
  std::string path;
  const auto add = [&](double column, double row, char command) {
    const Vector<Dim> index = plane.index_at(column, row, grid);
    const Vector<Dim> moved = grid.to_index(grid.to_world(index) + sample(displacement, index));
    const Vector<2> point = plane.picture_point(moved, grid);
    char text[64];
    std::snprintf(text, sizeof text, "%c%.1f %.1f", command, point[0], point[1]);
    path += text;
  };
  const auto add_lines = [&](double across, double along, const auto& point) {
    for (double line = distance / 2; line < across; line += distance) {
      char command = 'M';
      for (double at = 0; at <= along + 1e-9; at += step, command = 'L') point(line, at, command);
    }
  };
  add_lines(plane.width, plane.height, [&](double line, double at, char command) { add(line, at, command); });
  add_lines(plane.height, plane.width, [&](double line, double at, char command) { add(at, line, command); });
  return path;
}

template std::string deformed_grid_path(const VectorVolume<2>&, const SlicePlane<2>&);
template std::string deformed_grid_path(const VectorVolume<3>&, const SlicePlane<3>&);

}  // namespace saltus::report
