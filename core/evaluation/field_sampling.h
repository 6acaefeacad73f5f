#pragma once

#include <vector>

#include "core/grid/volume.h"

namespace saltus {

/// Displacement at a world point (mm): linear between voxel centres; beyond them the border's value is used.
template <int Dim>
Vector<Dim> displacement_at(const VectorVolume<Dim>& field, const Vector<Dim>& world);

/// Each point plus the displacement there, in the same order. With a registration's `displacement` fixed points become
/// moving points; with its `inverse_displacement` moving points become fixed points.
template <int Dim>
std::vector<Vector<Dim>> transform_points(const VectorVolume<Dim>& field, const std::vector<Vector<Dim>>& points);

}  // namespace saltus
