#pragma once

#include "core/grid/image_grid.h"

#include <vector>

namespace saltus {

/// Scalar image: samples[i], x fastest.
template <int Dim>
struct Volume {
  ImageGrid<Dim> grid;
  std::vector<float> samples;

  Volume() = default;
  explicit Volume(const ImageGrid<Dim>& where, float value = 0.0f) : grid(where), samples(where.voxels(), value) {}
};

/// Vector image, one plane per component: component c of voxel i is samples[c * grid.voxels() + i].
template <int Dim>
struct VectorVolume {
  ImageGrid<Dim> grid;
  std::vector<float> samples;

  VectorVolume() = default;
  explicit VectorVolume(const ImageGrid<Dim>& where) : grid(where), samples(Dim * where.voxels(), 0.0f) {}

  float* component(int c) { return samples.data() + c * grid.voxels(); }
  const float* component(int c) const { return samples.data() + c * grid.voxels(); }
};

/// World point of the fixed image -> world point of the moving image: linear * x + offset.
template <int Dim>
struct AffineMap {
  Matrix<Dim> linear = Matrix<Dim>::Identity();
  Vector<Dim> offset = Vector<Dim>::Zero();

  Vector<Dim> operator()(const Vector<Dim>& world) const { return linear * world + offset; }
  bool operator==(const AffineMap&) const = default;
};

}  // namespace saltus
