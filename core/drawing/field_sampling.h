#pragma once

#include "core/grid/interpolation.h"
#include "core/grid/volume.h"

#include <cstddef>
#include <optional>

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

/// The voxel at an index that is one, where a single sample says it all; else none. Volumes are drawn voxel by voxel.
template <int Dim>
std::optional<std::size_t> voxel_at(const ImageGrid<Dim>& grid, const Vector<Dim>& index) {
  std::size_t voxel = 0, stride = 1;
  for (int axis = 0; axis < Dim; ++axis) {
    const double at = index[axis];
    if (!(at >= 0 && at < grid.size[axis])) return std::nullopt;
    const auto whole = static_cast<std::size_t>(at);
    if (static_cast<double>(whole) != at) return std::nullopt;
    voxel += stride * whole;
    stride *= static_cast<std::size_t>(grid.size[axis]);
  }
  return voxel;
}

/// Linear interpolation of one sample per voxel at a continuous index; beyond the grid the border's value.
template <int Dim>
double sample(const ImageGrid<Dim>& grid, const float* samples, const Vector<Dim>& index) {
  if (const auto voxel = voxel_at(grid, index)) return samples[*voxel];
  const LinearCell<Dim, double> cell = cell_at(grid, index);
  double sum = 0;
  for (int bits = 0; bits < cell.corners; ++bits) sum += cell.weight(bits) * samples[cell.corner(bits)];
  return sum;
}

template <int Dim>
Vector<Dim> sample(const VectorVolume<Dim>& field, const Vector<Dim>& index) {
  const std::size_t voxels = field.grid.voxels();
  Vector<Dim> vector = Vector<Dim>::Zero();
  if (const auto voxel = voxel_at(field.grid, index)) {
    for (std::size_t c = 0; c < Dim; ++c) vector[c] = field.samples[c * voxels + *voxel];
    return vector;
  }
  const LinearCell<Dim, double> cell = cell_at(field.grid, index);
  for (int bits = 0; bits < cell.corners; ++bits) {
    const double weight = cell.weight(bits);
    const float* at = field.samples.data() + cell.corner(bits);
    for (int c = 0; c < Dim; ++c) vector[c] += weight * at[static_cast<std::size_t>(c) * voxels];
  }
  return vector;
}

}  // namespace saltus::drawing
