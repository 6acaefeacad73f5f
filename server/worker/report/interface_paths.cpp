#include "server/worker/report/interface_paths.h"

#include "core/drawing/colour_map.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

namespace saltus::report {

using namespace drawing;

namespace {

// One path for each class of slip, so that a page does not carry a colour for each of a thousand faces.
constexpr int classes = 12;

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

void add_square(std::string& path, const Vector<2>& a, const Vector<2>& b) {
  char text[128];
  std::snprintf(text, sizeof text, "M%.1f %.1fL%.1f %.1fL%.1f %.1fL%.1f %.1fZ", a[0], a[1], b[0], a[1], b[0], b[1],
                a[0], b[1]);
  path += text;
}

}  // namespace

template <int Dim>
std::string interface_paths(const DetectedInterface<Dim>& found, const ImageGrid<Dim>& grid,
                            const SlicePlane<Dim>& plane, double most_mm) {
  std::array<std::string, classes> lines, squares;
  for (const InterfaceFace<Dim>& face : found.faces) {
    if (plane.slice_axis >= 0 && face.voxel[plane.slice_axis] != std::lround(plane.position[plane.slice_axis]))
      continue;
    const int kind = std::clamp(static_cast<int>(classes * face.slip_mm / most_mm), 0, classes - 1);
    Vector<Dim> half = Vector<Dim>::Zero();
    for (int axis : {plane.right_axis, plane.down_axis})
      if (axis != face.axis) half[axis] = 0.5;
    const Vector<2> a = plane.picture_point(face.middle() - half, grid);
    const Vector<2> b = plane.picture_point(face.middle() + half, grid);
    face.axis == plane.slice_axis ? add_square(squares[kind], a, b) : add_line(lines[kind], a, b);
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

template std::string interface_paths(const DetectedInterface<2>&, const ImageGrid<2>&, const SlicePlane<2>&, double);
template std::string interface_paths(const DetectedInterface<3>&, const ImageGrid<3>&, const SlicePlane<3>&, double);

}  // namespace saltus::report
