#include "core/grid/image_grid.h"

#include <algorithm>
#include <cmath>
#include <sstream>

namespace saltus {

template <int Dim>
std::size_t ImageGrid<Dim>::voxels() const {
  std::size_t count = 1;
  for (int extent : size) count *= static_cast<std::size_t>(extent);
  return count;
}

template <int Dim>
double ImageGrid<Dim>::voxel_volume() const {
  return spacing.prod();
}

template <int Dim>
Vector<Dim> ImageGrid<Dim>::to_world(const Vector<Dim>& continuous_index) const {
  return origin + direction * spacing.cwiseProduct(continuous_index);
}

template <int Dim>
Vector<Dim> ImageGrid<Dim>::to_index(const Vector<Dim>& world) const {
  return (direction.transpose() * (world - origin)).cwiseQuotient(spacing);
}

template <int Dim>
bool ImageGrid<Dim>::operator==(const ImageGrid& other) const {
  return size == other.size && spacing == other.spacing && origin == other.origin && direction == other.direction;
}

template <int Dim>
std::string size_text(const Index<Dim>& size) {
  std::string text;
  for (int extent : size) text += (text.empty() ? "" : "x") + std::to_string(extent);
  return text;
}

template <int Dim>
double largest_distance(const ImageGrid<Dim>& a, const ImageGrid<Dim>& b) {
  // The maps are affine, so no voxel is farther apart than some corner.
  double largest = 0;
  for (int bits = 0; bits < 1 << Dim; ++bits) {
    Vector<Dim> corner;
    for (int axis = 0; axis < Dim; ++axis) corner[axis] = bits >> axis & 1 ? a.size[axis] - 1 : 0;
    const double apart = (a.to_world(corner) - b.to_world(corner)).norm();
    if (std::isnan(apart)) return apart;
    largest = std::max(largest, apart);
  }
  return largest;
}

template <int Dim>
std::vector<std::string> problems(const ImageGrid<Dim>& grid, double direction_tolerance) {
  std::vector<std::string> found;
  auto report = [&found](const auto&... parts) {
    std::ostringstream text;
    (text << ... << parts);
    found.push_back(text.str());
  };
  for (int axis = 0; axis < Dim; ++axis) {
    if (grid.size[axis] < 1) report("size[", axis, "] is ", grid.size[axis], "; it must be at least 1");
    if (!(grid.spacing[axis] > 0) || !std::isfinite(grid.spacing[axis]))
      report("spacing[", axis, "] is ", grid.spacing[axis], "; it must be finite and positive");
    if (!std::isfinite(grid.origin[axis])) report("origin[", axis, "] is ", grid.origin[axis], "; it must be finite");
  }
  const double deviation =
      (grid.direction.transpose() * grid.direction - Matrix<Dim>::Identity()).cwiseAbs().maxCoeff();
  if (!(deviation <= direction_tolerance))
    report("direction deviates from orthonormal by ", deviation, "; its columns must be perpendicular unit vectors");
  return found;
}

template struct ImageGrid<2>;
template struct ImageGrid<3>;
template std::string size_text<2>(const Index<2>&);
template std::string size_text<3>(const Index<3>&);
template double largest_distance(const ImageGrid<2>&, const ImageGrid<2>&);
template double largest_distance(const ImageGrid<3>&, const ImageGrid<3>&);
template std::vector<std::string> problems(const ImageGrid<2>&, double);
template std::vector<std::string> problems(const ImageGrid<3>&, double);

}  // namespace saltus
