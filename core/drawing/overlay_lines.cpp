#include "core/drawing/overlay_lines.h"

#include "core/drawing/field_sampling.h"

#include <algorithm>
#include <cstdio>

namespace saltus::drawing {
namespace {

constexpr int lines_along_longest_side = 24;
constexpr int points_along_longest_side = 192;
constexpr int arrows_along_longest_side = 16;

}  // namespace

template <int Dim>
Strokes deformed_grid_lines(const VectorVolume<Dim>& displacement, const SlicePlane<Dim>& plane) {
  const ImageGrid<Dim>& grid = displacement.grid;
  const double longest = std::max(plane.width, plane.height);
  const double distance = longest / lines_along_longest_side;
  const double step = std::max(1.0, longest / points_along_longest_side);
  Strokes lines;
  const auto add = [&](double column, double row) {
    const Vector<Dim> index = plane.index_at(column, row, grid);
    const Vector<Dim> moved = grid.to_index(grid.to_world(index) + sample(displacement, index));
    lines.back().push_back(plane.picture_point(moved, grid));
  };
  const auto add_lines = [&](double across, double along, const auto& point) {
    for (double line = distance / 2; line < across; line += distance) {
      lines.emplace_back();
      for (double at = 0; at <= along + 1e-9; at += step) point(line, at);
    }
  };
  add_lines(plane.width, plane.height, [&](double line, double at) { add(line, at); });
  add_lines(plane.height, plane.width, [&](double line, double at) { add(at, line); });
  return lines;
}

template <int Dim>
Strokes arrow_lines(const VectorVolume<Dim>& displacement, const SlicePlane<Dim>& plane, double longest_mm) {
  const ImageGrid<Dim>& grid = displacement.grid;
  const double distance = static_cast<double>(std::max(plane.width, plane.height)) / arrows_along_longest_side;
  Strokes arrows;
  for (double row = distance / 2; row < plane.height; row += distance)
    for (double column = distance / 2; column < plane.width; column += distance) {
      const Vector<Dim> index = plane.index_at(column, row, grid);
      const Vector<Dim> moved = grid.to_index(grid.to_world(index) + sample(displacement, index));
      const Vector<2> middle(column, row);
      const Vector<2> arrow =
          (plane.picture_point(moved, grid) - middle) * plane.pixel_mm / longest_mm * 0.9 * distance;
      // What is too short for a head would only be dirt.
      if (!(arrow.norm() > 0.12 * distance)) continue;
      const Vector<2> tip = middle + arrow / 2, across(-arrow[1], arrow[0]);
      const double head = std::min(0.35, 0.2 * distance / arrow.norm());
      arrows.push_back({middle - arrow / 2, tip});
      arrows.push_back({tip - head * arrow + 0.6 * head * across, tip, tip - head * arrow - 0.6 * head * across});
    }
  return arrows;
}

std::string svg_path(const Strokes& strokes) {
  std::string path;
  for (const Stroke& stroke : strokes) {
    char command = 'M';
    for (const Vector<2>& point : stroke) {
      char text[64];
      std::snprintf(text, sizeof text, "%c%.1f %.1f", command, point[0], point[1]);
      path += text;
      command = 'L';
    }
  }
  return path;
}

template Strokes arrow_lines(const VectorVolume<2>&, const SlicePlane<2>&, double);
template Strokes arrow_lines(const VectorVolume<3>&, const SlicePlane<3>&, double);
template Strokes deformed_grid_lines(const VectorVolume<2>&, const SlicePlane<2>&);
template Strokes deformed_grid_lines(const VectorVolume<3>&, const SlicePlane<3>&);

}  // namespace saltus::drawing
