#include "server/worker/report/slip_marks.h"

#include "core/drawing/colour_map.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <map>

namespace saltus::report {

using namespace drawing;

namespace {

// One path for each class of slip, so that a page does not carry a colour for each of a thousand pieces.
constexpr int classes = 12;
constexpr double parallel = 0.95;  // cosine between normals of a piece and of a slice that it lies in
constexpr double neighbourhood = 3;

std::string text_of(const Colour& colour) {
  char text[8];
  std::snprintf(text, sizeof text, "#%02x%02x%02x", colour[0], colour[1], colour[2]);
  return text;
}

void add_line(std::string& path, const Vector<2>& from, const Vector<2>& to) {
  char text[96];
  std::snprintf(text, sizeof text, "M%.1f %.1fL%.1f %.1f", from[0], from[1], to[0], to[1]);
  path += text;
}

void add_square(std::string& path, const Vector<2>& middle, double side) {
  char text[96];
  std::snprintf(text, sizeof text, "M%.1f %.1fh%.1fv%.1fh%.1fZ", middle[0] - side / 2, middle[1] - side / 2, side, side,
                -side);
  path += text;
}

}  // namespace

template <int Dim>
std::string slip_marks(const SlipSurface<Dim>& surface, const ImageGrid<Dim>& grid, const SlicePlane<Dim>& plane,
                       double most_mm) {
  std::array<std::string, classes> lines, squares;
  for (const SlipPoint<Dim>& point : surface.points) {
    const Vector<Dim> at = grid.to_index(point.position);
    const int kind = std::clamp(static_cast<int>(classes * point.jump.norm() / most_mm), 0, classes - 1);
    Vector<Dim> along;
    double length = point.area;
    if constexpr (Dim == 2) {
      along = Vector<2>(-point.normal[1], point.normal[0]);
    } else {
      if (std::lround(at[plane.slice_axis]) != std::lround(plane.position[plane.slice_axis])) continue;
      length = std::sqrt(point.area);
      const Vector<3> across = grid.direction.col(plane.slice_axis);
      if (std::abs(point.normal.dot(across)) > parallel) {
        add_square(squares[kind], plane.picture_point(at, grid), length / plane.pixel_mm);
        continue;
      }
      along = point.normal.cross(across).normalized();
    }
    const Vector<Dim> half = length / 2 * along;
    add_line(lines[kind], plane.picture_point(grid.to_index(point.position - half), grid),
             plane.picture_point(grid.to_index(point.position + half), grid));
  }
  std::string paths;
  for (int kind = 0; kind < classes; ++kind) {
    const std::string colour = text_of(interface_colour((kind + 0.5) / classes));
    if (!squares[kind].empty())
      paths += "<path class=\"face\" style=\"fill:" + colour + "\" d=\"" + squares[kind] + "\"/>";
    if (!lines[kind].empty()) paths += "<path style=\"stroke:" + colour + "\" d=\"" + lines[kind] + "\"/>";
  }
  return paths;
}

template <int Dim>
std::optional<Vector<Dim>> strongest_slip(const SlipSurface<Dim>& surface, const ImageGrid<Dim>& grid) {
  std::map<Index<Dim>, double> strength;  // by cubes of voxels, each counted in those around it as well
  const auto cube_of = [&](const SlipPoint<Dim>& point) {
    const Vector<Dim> at = grid.to_index(point.position);
    Index<Dim> cube;
    for (int a = 0; a < Dim; ++a) cube[a] = static_cast<int>(std::floor(at[a] / neighbourhood));
    return cube;
  };
  for (const SlipPoint<Dim>& point : surface.points) {
    const Index<Dim> middle = cube_of(point);
    for (int i = 0, all = Dim == 2 ? 9 : 27; i < all; ++i) {
      Index<Dim> cube = middle;
      for (int a = 0, rest = i; a < Dim; ++a, rest /= 3) cube[a] += rest % 3 - 1;
      strength[cube] += point.area * point.jump.norm();
    }
  }
  const SlipPoint<Dim>* best = nullptr;
  double most = 0;
  for (const SlipPoint<Dim>& point : surface.points)
    if (const double here = strength[cube_of(point)]; !best || here > most) best = &point, most = here;
  if (!best) return std::nullopt;
  return grid.to_index(best->position);
}

#define SALTUS_SLIP_MARKS(DIM)                                                                                     \
  template std::string slip_marks(const SlipSurface<DIM>&, const ImageGrid<DIM>&, const SlicePlane<DIM>&, double); \
  template std::optional<Vector<DIM>> strongest_slip(const SlipSurface<DIM>&, const ImageGrid<DIM>&);
SALTUS_SLIP_MARKS(2)
SALTUS_SLIP_MARKS(3)
#undef SALTUS_SLIP_MARKS

}  // namespace saltus::report
