#include "core/evaluation/jacobian.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

#include "core/evaluation/statistics.h"

namespace saltus {
namespace {

template <int Dim>
Index<Dim> index_of(const ImageGrid<Dim>& grid, std::size_t voxel) {
  Index<Dim> index;
  for (int axis = 0; axis < Dim; ++axis) {
    index[axis] = static_cast<int>(voxel % static_cast<std::size_t>(grid.size[axis]));
    voxel /= static_cast<std::size_t>(grid.size[axis]);
  }
  return index;
}

}  // namespace

template <int Dim>
Volume<Dim> jacobian_determinant(const VectorVolume<Dim>& displacement) {
  const ImageGrid<Dim>& grid = displacement.grid;
  Volume<Dim> jacobian(grid);
  // Derivatives along the grid's axes become derivatives along the world's.
  const Matrix<Dim> to_world_axes = grid.direction.inverse();
  const auto count = static_cast<std::ptrdiff_t>(grid.voxels());
#pragma omp parallel for schedule(static)
  for (std::ptrdiff_t voxel = 0; voxel < count; ++voxel) {
    const Index<Dim> index = index_of(grid, static_cast<std::size_t>(voxel));
    Matrix<Dim> gradient = Matrix<Dim>::Zero();
    std::ptrdiff_t stride = 1;
    for (int axis = 0; axis < Dim; ++axis) {
      const std::ptrdiff_t ahead = index[axis] + 1 < grid.size[axis] ? stride : 0;
      const std::ptrdiff_t behind = index[axis] > 0 ? stride : 0;
      const double length = static_cast<double>((ahead != 0) + (behind != 0)) * grid.spacing[axis];
      for (int c = 0; c < Dim && length > 0; ++c) {
        const float* u = displacement.component(c) + voxel;
        gradient(c, axis) = (static_cast<double>(u[ahead]) - static_cast<double>(u[-behind])) / length;
      }
      stride *= grid.size[axis];
    }
    jacobian.samples[voxel] = static_cast<float>((Matrix<Dim>::Identity() + gradient * to_world_axes).determinant());
  }
  return jacobian;
}

template <int Dim>
JacobianStatistics jacobian_statistics(const Volume<Dim>& jacobian) {
  JacobianStatistics statistics;
  statistics.min = std::numeric_limits<double>::infinity();
  statistics.max = -statistics.min;
  std::size_t not_positive = 0;
  std::vector<double> logarithms;
  for (std::size_t voxel = 0; voxel < jacobian.samples.size(); ++voxel) {
    const Index<Dim> index = index_of(jacobian.grid, voxel);
    bool is_interior = true;
    for (int axis = 0; axis < Dim; ++axis)
      if (const int size = jacobian.grid.size[axis]; size > 2)
        is_interior = is_interior && index[axis] > 0 && index[axis] < size - 1;
    if (!is_interior) continue;
    const double value = jacobian.samples[voxel];
    ++statistics.n;
    statistics.min = std::min(statistics.min, value);
    statistics.max = std::max(statistics.max, value);
    if (value > 0) {
      logarithms.push_back(std::log(value));
    } else {
      ++not_positive;
    }
  }
  statistics.share_not_positive = static_cast<double>(not_positive) / static_cast<double>(statistics.n);
  statistics.sd_log = summarise(std::move(logarithms)).sd;
  return statistics;
}

#define SALTUS_INSTANTIATE(Dim)                                        \
  template Volume<Dim> jacobian_determinant(const VectorVolume<Dim>&); \
  template JacobianStatistics jacobian_statistics(const Volume<Dim>&);
SALTUS_INSTANTIATE(2)
SALTUS_INSTANTIATE(3)

}  // namespace saltus
