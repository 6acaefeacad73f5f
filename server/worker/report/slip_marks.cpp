#include "server/worker/report/slip_marks.h"

#include "server/worker/report/slip_paths.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <map>

namespace saltus::report {

using namespace drawing;

namespace {

constexpr double parallel = 0.95;  // cosine between normals of a piece and of a slice that it lies in
constexpr double neighbourhood = 3;

}  // namespace

template <int Dim>
std::string slip_marks(const SlipSurface<Dim>& surface, const ImageGrid<Dim>& grid, const SlicePlane<Dim>& plane,
                       double most_mm) {
  SlipPaths paths(most_mm);
  for (const SlipPoint<Dim>& point : surface.points) {
    const Vector<Dim> at = grid.to_index(point.position);
    const double slip = point.jump.norm();
    Vector<Dim> along;
    double length = point.area;
    if constexpr (Dim == 2) {
      along = Vector<2>(-point.normal[1], point.normal[0]);
    } else {
      if (std::lround(at[plane.slice_axis]) != std::lround(plane.position[plane.slice_axis])) continue;
      length = std::sqrt(point.area);
      const Vector<3> across = grid.direction.col(plane.slice_axis);
      if (std::abs(point.normal.dot(across)) > parallel) {
        const Vector<2> middle = plane.picture_point(at, grid), half = Vector<2>::Constant(length / plane.pixel_mm / 2);
        paths.add_rectangle(slip, middle - half, middle + half);
        continue;
      }
      along = point.normal.cross(across).normalized();
    }
    const Vector<Dim> half = length / 2 * along;
    paths.add_line(slip, plane.picture_point(grid.to_index(point.position - half), grid),
                   plane.picture_point(grid.to_index(point.position + half), grid));
  }
  return paths.text();
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
