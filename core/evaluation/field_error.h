#pragma once

#include <optional>
#include <vector>

#include "core/evaluation/statistics.h"
#include "core/grid/volume.h"

namespace saltus {

/// Target registration error, mm: |p + u(p) - q| of each pair of a fixed landmark p and its moving landmark q.
/// Throws InvalidInput when the lists differ in length or are empty.
template <int Dim>
std::vector<double> landmark_errors(const VectorVolume<Dim>& displacement, const std::vector<Vector<Dim>>& fixed_points,
                                    const std::vector<Vector<Dim>>& moving_points);

/// The same before registration, |p - q|.
template <int Dim>
std::vector<double> landmark_distances(const std::vector<Vector<Dim>>& fixed_points,
                                       const std::vector<Vector<Dim>>& moving_points);

/// Endpoint error, mm: |u - truth| at each voxel where `mask` is above 0 (everywhere without one), in voxel order.
/// Throws InvalidInput when the grids differ or the mask is empty.
template <int Dim>
std::vector<double> endpoint_errors(const VectorVolume<Dim>& displacement, const VectorVolume<Dim>& truth,
                                    const std::optional<Volume<Dim>>& mask = {});

}  // namespace saltus
