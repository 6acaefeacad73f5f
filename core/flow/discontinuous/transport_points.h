#pragma once

#include "core/flow/discontinuous/gridded_velocity.h"
#include "core/flow/discontinuous/trajectory.h"

namespace saltus {

enum class TransportDirection {
  FixedToMoving,  ///< psi_1 = phi_1^-1: backwards in time
  MovingToFixed   ///< phi_1
};

/// Tolerances for a velocity that is linear between samples: positions to 1e-4 of the smallest spacing a step, the
/// fundamental matrix to 1e-2. A point that touches a sheet to within grazing keeps to its side, for sheets move with
/// the flow.
template <int Dim>
TrajectoryOptions gridded_trajectory_options(const Lattice<Dim>& lattice);

/// Follows points (mm in the frame, grid/lattice.h) through the whole flow, each on its own side of the sheets.
/// Throws InvalidInput when a point is not finite or as check(options). Threads over points; the result does not
/// depend on their number.
template <int Dim, class T>
std::vector<TransportedPoint<Dim>> transport_points(const GriddedVelocity<Dim, T>& velocity,
                                                    const std::vector<Vector<Dim>>& points,
                                                    TransportDirection direction, const TrajectoryOptions& options);

}  // namespace saltus
