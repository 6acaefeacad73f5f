#pragma once

#include "core/grid/interpolation.h"
#include "core/grid/volume.h"

namespace saltus::drawing {

/// The cell of a grid's voxels around a continuous index; beyond the grid the border's.
template <int Dim>
LinearCell<Dim, double> cell_at(const ImageGrid<Dim>& grid, const Vector<Dim>& index) {
  Lattice<Dim> voxels;
  voxels.size = grid.size;
  std::array<double, Dim> at;
  for (int axis = 0; axis < Dim; ++axis) at[axis] = index[axis];
  return {voxels, at};
}

/// Where one sample says it all.
template <int Dim>
bool is_at_voxel(const LinearCell<Dim, double>& cell) {
  for (double fraction : cell.fraction)
    if (fraction != 0) return false;
  return true;
}

/// Linear interpolation of one sample per voxel at a continuous index; beyond the grid the border's value.
template <int Dim>
double sample(const ImageGrid<Dim>& grid, const float* samples, const Vector<Dim>& index) {
  const LinearCell<Dim, double> cell = cell_at(grid, index);
  if (is_at_voxel(cell)) return samples[cell.base];
  double sum = 0;
  for (int bits = 0; bits < cell.corners; ++bits) sum += cell.weight(bits) * samples[cell.corner(bits)];
  return sum;
}

template <int Dim>
Vector<Dim> sample(const VectorVolume<Dim>& field, const Vector<Dim>& index) {
  const LinearCell<Dim, double> cell = cell_at(field.grid, index);
  const std::size_t voxels = field.grid.voxels();
  Vector<Dim> vector = Vector<Dim>::Zero();
  const int corners = is_at_voxel(cell) ? 1 : cell.corners;
  for (int bits = 0; bits < corners; ++bits) {
    const double weight = cell.weight(bits);
    const float* at = field.samples.data() + cell.corner(bits);
    for (int c = 0; c < Dim; ++c) vector[c] += weight * at[static_cast<std::size_t>(c) * voxels];
  }
  return vector;
}

}  // namespace saltus::drawing
