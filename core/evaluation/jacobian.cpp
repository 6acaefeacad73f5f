#include "core/evaluation/jacobian.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "core/support/reduction.h"

namespace saltus {
template <int Dim>
Volume<Dim> jacobian_determinant(const VectorVolume<Dim>& displacement) {
  const ImageGrid<Dim>& grid = displacement.grid;
  Volume<Dim> jacobian(grid);
  // Derivatives along the grid's axes become derivatives along the world's.
  const Matrix<Dim> to_world_axes = grid.direction.inverse();
  const int width = grid.size[0], height = Dim == 3 ? grid.size[1] : 1, rows = height * grid.size[Dim - 1];
  std::array<const float*, Dim> u;
  for (int c = 0; c < Dim; ++c) u[c] = displacement.component(c);
#pragma omp parallel for schedule(static)
  for (int row = 0; row < rows; ++row) {
    Index<Dim> index;
    index[Dim - 1] = row / height;
    if constexpr (Dim == 3) index[1] = row % height;
    const std::ptrdiff_t first = static_cast<std::ptrdiff_t>(row) * width;
    for (int x = 0; x < width; ++x) {
      index[0] = x;
      Matrix<Dim> gradient = Matrix<Dim>::Zero();
      std::ptrdiff_t stride = 1;
      for (int axis = 0; axis < Dim; ++axis) {
        const std::ptrdiff_t ahead = index[axis] + 1 < grid.size[axis] ? stride : 0;
        const std::ptrdiff_t behind = index[axis] > 0 ? stride : 0;
        const double length = static_cast<double>((ahead != 0) + (behind != 0)) * grid.spacing[axis];
        for (int c = 0; c < Dim && length > 0; ++c) {
          const float* at = u[c] + first + x;
          gradient(c, axis) = (static_cast<double>(at[ahead]) - static_cast<double>(at[-behind])) / length;
        }
        stride *= grid.size[axis];
      }
      jacobian.samples[static_cast<std::size_t>(first + x)] =
          static_cast<float>((Matrix<Dim>::Identity() + gradient * to_world_axes).determinant());
    }
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
  const ImageGrid<Dim>& grid = jacobian.grid;
  logarithms.reserve(grid.voxels());
  std::array<int, 3> begin{}, end{1, 1, 1};
  for (int axis = 0; axis < Dim; ++axis) {
    begin[axis] = grid.size[axis] > 2 ? 1 : 0;
    end[axis] = grid.size[axis] - begin[axis];
  }
  for (int z = begin[2]; z < end[2]; ++z)
    for (int y = begin[1]; y < end[1]; ++y) {
      const float* row = jacobian.samples.data() + (static_cast<std::size_t>(z) * grid.size[1] + y) * grid.size[0];
      for (int x = begin[0]; x < end[0]; ++x) {
        const double value = row[x];
        statistics.min = std::min(statistics.min, value);
        statistics.max = std::max(statistics.max, value);
        if (value > 0) {
          logarithms.push_back(value);
        } else {
          ++not_positive;
        }
      }
    }
  const std::size_t positive = logarithms.size();
  statistics.n = positive + not_positive;
  statistics.share_not_positive = static_cast<double>(not_positive) / static_cast<double>(statistics.n);
  if (positive == 0) return statistics;
#pragma omp parallel for schedule(static)
  for (std::size_t i = 0; i < positive; ++i) logarithms[i] = std::log(logarithms[i]);
  const auto count = static_cast<double>(positive);
  const double mean = ordered_sum(positive, [&](std::size_t i) { return logarithms[i]; }) / count;
  const auto square = [&](std::size_t i) { return (logarithms[i] - mean) * (logarithms[i] - mean); };
  statistics.sd_log = std::sqrt(ordered_sum(positive, square) / count);
  return statistics;
}

#define SALTUS_INSTANTIATE(Dim)                                        \
  template Volume<Dim> jacobian_determinant(const VectorVolume<Dim>&); \
  template JacobianStatistics jacobian_statistics(const Volume<Dim>&);
SALTUS_INSTANTIATE(2)
SALTUS_INSTANTIATE(3)

}  // namespace saltus
