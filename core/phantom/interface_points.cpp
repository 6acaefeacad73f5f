#include "core/phantom/interface_points.h"

#include <cmath>

namespace saltus {
namespace {

/// Gradient of the signed distance by central differences.
template <int Dim>
Vector<Dim> distance_gradient(const Scene<Dim>& scene, const Vector<Dim>& x, double step_mm) {
  Vector<Dim> gradient;
  for (int axis = 0; axis < Dim; ++axis) {
    const Vector<Dim> step = step_mm * Vector<Dim>::Unit(axis);
    gradient[axis] = (scene.interface_distance(x + step) - scene.interface_distance(x - step)) / (2 * step_mm);
  }
  return gradient;
}

}  // namespace

template <int Dim>
std::vector<InterfacePoint<Dim>> interface_points(const Scene<Dim>& scene, const ImageGrid<Dim>& grid) {
  const double spacing = grid.spacing.minCoeff(), step = 1e-3 * spacing;
  std::vector<InterfacePoint<Dim>> points;
  for (std::size_t voxel = 0; voxel < grid.voxels(); ++voxel) {
    Vector<Dim> index;
    std::size_t rest = voxel;
    for (int axis = 0; axis < Dim; ++axis) {
      index[axis] = static_cast<double>(rest % grid.size[axis]);
      rest /= grid.size[axis];
    }
    const Vector<Dim> x = grid.to_world(index);
    const double distance = scene.interface_distance(x);
    if (!(std::abs(distance) <= 0.5 * grid.spacing.maxCoeff())) continue;
    const Vector<Dim> gradient = distance_gradient(scene, x, step);
    if (!(gradient.norm() > 0.5)) continue;  // no distance has such a slope: a ridge between two interfaces
    InterfacePoint<Dim> point;
    point.normal = gradient.normalized();
    if (!(std::abs(distance) <= 0.5 * point.normal.cwiseProduct(grid.spacing).cwiseAbs().maxCoeff())) continue;
    point.position = x - distance / gradient.norm() * point.normal;
    const Vector<Dim> inner = point.position - step * point.normal, outer = point.position + step * point.normal;
    if (!scene.is_valid(inner) || !scene.is_valid(outer)) continue;
    Vector<Dim> jump = (scene.to_moving(outer) - outer) - (scene.to_moving(inner) - inner);
    jump -= jump.dot(point.normal) * point.normal;
    if (!(jump.norm() > 10 * step)) continue;  // smooth motion differs by less over such a distance
    point.tangent = jump.normalized();
    points.push_back(point);
  }
  return points;
}

template std::vector<InterfacePoint<2>> interface_points(const Scene<2>&, const ImageGrid<2>&);
template std::vector<InterfacePoint<3>> interface_points(const Scene<3>&, const ImageGrid<3>&);

}  // namespace saltus
