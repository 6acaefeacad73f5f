#pragma once

#include "core/flow/geodesic_shooting.h"
#include "core/momenta/momentum_scale.h"
#include "core/registration/register_images.h"

namespace saltus {

/// Throws InvalidInput when a point is not finite.
template <int Dim>
void check_points(const std::vector<Vector<Dim>>& points);

/// The input's fixed_points in the moving image: followed back through the flow as particles, each on its own side of
/// the switching sheets (flow/discontinuous/transport_points.h), and then through the affine start. Positions and
/// fundamental matrices in the world. `lattice`, `velocities`, `scales` and `momenta` are those of the last level.
template <int Dim>
std::vector<TransportedPoint<Dim>> move_points(const RegistrationInput<Dim>& input, const Lattice<Dim>& lattice,
                                               const std::vector<Field<float>>& velocities,
                                               const std::vector<MomentumScale<Dim, float>*>& scales,
                                               const std::vector<MomentumPointers<float>>& momenta);

}  // namespace saltus
