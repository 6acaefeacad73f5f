#include "core/grid/jacobian_determinant.h"

#include <Eigen/LU>
#include <array>
#include <cstddef>

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

template Volume<2> jacobian_determinant(const VectorVolume<2>&);
template Volume<3> jacobian_determinant(const VectorVolume<3>&);

}  // namespace saltus
