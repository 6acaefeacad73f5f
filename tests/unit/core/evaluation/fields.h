#pragma once

#include <cmath>

#include "core/grid/volume.h"

namespace saltus {

/// Anisotropic, off the origin, and turned: 30 degrees about z (in 3-D then 20 about x).
template <int Dim>
ImageGrid<Dim> oblique_grid() {
  ImageGrid<Dim> grid;
  const double c = std::cos(0.5235987755982988), s = std::sin(0.5235987755982988);
  for (int axis = 0; axis < Dim; ++axis) {
    grid.size[axis] = 9 + 2 * axis;
    grid.spacing[axis] = 0.8 + 0.7 * axis;
    grid.origin[axis] = -20 + 13 * axis;
  }
  grid.direction.template topLeftCorner<2, 2>() << c, -s, s, c;
  if constexpr (Dim == 3) {
    Matrix<3> tilt = Matrix<3>::Identity();
    tilt.bottomRightCorner<2, 2>() << std::cos(0.35), -std::sin(0.35), std::sin(0.35), std::cos(0.35);
    grid.direction = (tilt * grid.direction).eval();
  }
  return grid;
}

/// Calls visit(voxel, world point) for every voxel.
template <int Dim, typename Visit>
void for_each_voxel(const ImageGrid<Dim>& grid, const Visit& visit) {
  for (std::size_t voxel = 0; voxel < grid.voxels(); ++voxel) {
    Vector<Dim> index;
    std::size_t rest = voxel;
    for (int axis = 0; axis < Dim; ++axis) {
      index[axis] = static_cast<double>(rest % grid.size[axis]);
      rest /= grid.size[axis];
    }
    visit(voxel, grid.to_world(index));
  }
}

/// The displacement u(x) = function(x).
template <int Dim, typename Function>
VectorVolume<Dim> make_field(const ImageGrid<Dim>& grid, const Function& function) {
  VectorVolume<Dim> field(grid);
  for_each_voxel(grid, [&](std::size_t voxel, const Vector<Dim>& world) {
    const Vector<Dim> u = function(world);
    for (int c = 0; c < Dim; ++c) field.component(c)[voxel] = static_cast<float>(u[c]);
  });
  return field;
}

template <int Dim, typename Function>
Volume<Dim> make_image(const ImageGrid<Dim>& grid, const Function& function) {
  Volume<Dim> image(grid);
  for_each_voxel(grid, [&](std::size_t voxel, const Vector<Dim>& world) {
    image.samples[voxel] = static_cast<float>(function(world));
  });
  return image;
}

/// A matrix without symmetry, so that transposed or swapped axes show.
template <int Dim>
Matrix<Dim> skewed_gradient() {
  Matrix<Dim> a;
  for (int row = 0; row < Dim; ++row)
    for (int column = 0; column < Dim; ++column)
      a(row, column) = 0.05 * (row + 1) - 0.11 * column + 0.02 * row * column;
  return a;
}

}  // namespace saltus
