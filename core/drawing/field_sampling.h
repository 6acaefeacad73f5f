#pragma once

#include "core/grid/interpolation.h"
#include "core/grid/volume.h"

namespace saltus::drawing {

/// Linear interpolation of one sample per voxel at a continuous index; beyond the grid the border's value.
template <int Dim>
double sample(const ImageGrid<Dim>& grid, const float* samples, const Vector<Dim>& index) {
  std::array<double, Dim> at;
  for (int axis = 0; axis < Dim; ++axis) at[axis] = index[axis];
  const LinearCell<Dim, double> cell(lattice_of(grid), at);
  double sum = 0;
  for (int bits = 0; bits < cell.corners; ++bits) sum += cell.weight(bits) * samples[cell.corner(bits)];
  return sum;
}

template <int Dim>
Vector<Dim> sample(const VectorVolume<Dim>& field, const Vector<Dim>& index) {
  Vector<Dim> vector;
  for (int c = 0; c < Dim; ++c) vector[c] = sample(field.grid, field.component(c), index);
  return vector;
}

}  // namespace saltus::drawing
