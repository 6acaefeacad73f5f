#pragma once

#include "core/momenta/momentum_scale.h"
#include "core/registration/matching_objective.h"
#include "core/registration/register_images.h"

#include <limits>

namespace saltus {

/// Continuous index of the moving image at frame point p (mm along the fixed grid's axes from its voxel 0), after the
/// affine start: linear * p + offset.
template <int Dim>
AffineMap<Dim> frame_to_index(const RegistrationInput<Dim>& input);

/// psi(x) - x in the frame, on the fixed image's lattice, from the velocities of a geodesic on `lattice`: followed at
/// full resolution, not interpolated.
template <int Dim>
Field<float> map_back(const RegistrationInput<Dim>& input, const Lattice<Dim>& lattice,
                      const std::vector<Field<float>>& velocities);

/// Fills displacement, inverse displacement, warped image, Jacobian and what the summary says of them; `backward` is
/// what map_back returned. The inverse is followed at full resolution too, and then brought to where the displacement,
/// taken linearly between voxels, leads back to where it started.
template <int Dim>
void write_fields(const RegistrationInput<Dim>& input, const Lattice<Dim>& lattice,
                  const std::vector<Field<float>>& velocities, const Field<float>& backward,
                  RegistrationResult<Dim>& result);

/// While the inverse is followed, so many slabs of the moving image's last axis are on their way at the same time: in
/// 3-D some, so that they hold little; as many for any number of threads, so that all give the same bits.
template <int Dim>
constexpr int kSlabsAtOnce = Dim == 3 ? 64 : std::numeric_limits<int>::max();

/// Fills the initial momenta and the share of active first-order sites; `momenta` are those of the scales.
template <int Dim>
void collect_momenta(const std::vector<MomentumScale<Dim, float>*>& scales,
                     const std::vector<MomentumPointers<float>>& momenta, const ImageGrid<Dim>& fixed,
                     RegistrationResult<Dim>& result);

/// Fills similarity before (affine start only) and after, at full resolution; `backward` is what map_back returned.
template <int Dim>
void summarise_similarity(const MatchingLevel<Dim, float>& full, const RegistrationOptions& options,
                          const Field<float>& backward, RegistrationResult<Dim>& result);

}  // namespace saltus
