#pragma once

#include <cmath>
#include <vector>

#include "core/grid/interpolation.h"
#include "core/grid/volume.h"
#include "tests/support/random_fields.h"

namespace saltus::testing {

/// A scene that is a function of the world, so that any grid can sample it: Gaussian blobs of `width` mm (25 % more or
/// less) with their centres within `radius` of the origin, and nothing far away.
template <int Dim>
class AnalyticScene {
 public:
  AnalyticScene(double radius, double width, int blobs, std::uint64_t seed) {
    Random random(seed);
    while (static_cast<int>(blobs_.size()) < blobs) {
      Blob blob;
      for (int c = 0; c < Dim; ++c) blob.centre[c] = radius * random.symmetric();
      blob.width = width * (1 + 0.25 * random.symmetric());
      blob.height = 1.2 + random.symmetric();
      if (blob.centre.norm() < radius) blobs_.push_back(blob);
    }
  }

  double operator()(const Vector<Dim>& world) const {
    double value = 0;
    for (const Blob& blob : blobs_)
      value += blob.height * std::exp(-(world - blob.centre).squaredNorm() / (blob.width * blob.width));
    return value;
  }

 private:
  struct Blob {
    Vector<Dim> centre;
    double width, height;
  };
  std::vector<Blob> blobs_;
};

/// Calls visit(world position, voxel) for all voxels.
template <int Dim, class Visit>
void for_voxels(const ImageGrid<Dim>& grid, Visit&& visit) {
  const Lattice<Dim> lattice = lattice_of(grid);
  for (int slab = 0; slab < grid.size[Dim - 1]; ++slab)
    visit_slab<Dim>(lattice, slab, [&](const Index<Dim>& index, std::size_t voxel) {
      Vector<Dim> at;
      for (int c = 0; c < Dim; ++c) at[c] = index[c];
      visit(grid.to_world(at), voxel);
    });
}

/// The image of f(world) on a grid.
template <int Dim, class Function>
Volume<Dim> sampled(const ImageGrid<Dim>& grid, Function&& f) {
  Volume<Dim> volume(grid);
  for_voxels<Dim>(
      grid, [&](const Vector<Dim>& world, std::size_t voxel) { volume.samples[voxel] = static_cast<float>(f(world)); });
  return volume;
}

/// A grid whose middle is at the world's origin.
template <int Dim>
ImageGrid<Dim> centred_grid(const Index<Dim>& size, const Vector<Dim>& spacing, const Matrix<Dim>& direction) {
  ImageGrid<Dim> grid;
  grid.size = size;
  grid.spacing = spacing;
  grid.direction = direction;
  Vector<Dim> middle;
  for (int c = 0; c < Dim; ++c) middle[c] = 0.5 * (size[c] - 1);
  grid.origin = -(direction * spacing.cwiseProduct(middle));
  return grid;
}

/// A vector field at a place of the world, linear between voxels.
template <int Dim>
Vector<Dim> vector_at(const VectorVolume<Dim>& field, const Vector<Dim>& world) {
  const Vector<Dim> index = field.grid.to_index(world);
  std::array<float, Dim> at;
  for (int c = 0; c < Dim; ++c) at[c] = static_cast<float>(index[c]);
  const LinearCell<Dim, float> cell(lattice_of(field.grid), at);
  Vector<Dim> value;
  for (int c = 0; c < Dim; ++c) value[c] = cell.template value<1>(field.component(c))[0];
  return value;
}

}  // namespace saltus::testing
