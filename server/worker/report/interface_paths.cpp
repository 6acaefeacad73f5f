#include "server/worker/report/interface_paths.h"

#include "server/worker/report/slip_paths.h"

#include <cmath>

namespace saltus::report {

using namespace drawing;

template <int Dim>
std::string interface_paths(const DetectedInterface<Dim>& found, const ImageGrid<Dim>& grid,
                            const SlicePlane<Dim>& plane, double most_mm) {
  SlipPaths paths(most_mm);
  for (const InterfaceFace<Dim>& face : found.faces) {
    if (plane.slice_axis >= 0 && face.voxel[plane.slice_axis] != std::lround(plane.position[plane.slice_axis]))
      continue;
    Vector<Dim> half = Vector<Dim>::Zero();
    for (int axis : {plane.right_axis, plane.down_axis})
      if (axis != face.axis) half[axis] = 0.5;
    const Vector<2> a = plane.picture_point(face.middle() - half, grid);
    const Vector<2> b = plane.picture_point(face.middle() + half, grid);
    face.axis == plane.slice_axis ? paths.add_rectangle(face.slip_mm, a, b) : paths.add_line(face.slip_mm, a, b);
  }
  return paths.text();
}

template std::string interface_paths(const DetectedInterface<2>&, const ImageGrid<2>&, const SlicePlane<2>&, double);
template std::string interface_paths(const DetectedInterface<3>&, const ImageGrid<3>&, const SlicePlane<3>&, double);

}  // namespace saltus::report
