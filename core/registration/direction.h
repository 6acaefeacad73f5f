#pragma once

#include "core/grid/lattice.h"
#include "core/registration/register_images.h"

namespace saltus {

/// The unit vectors w of model `directional` at the fixed image's voxels, Dim components a voxel, in the frame: from
/// the input's direction field or the parameter `direction`. Empty for other models.
///
/// Throws InvalidInput when `directional` has no direction or two, another model has one, the field is not on the fixed
/// grid, a vector is neither 0 nor of length 1 (within 1 %), or there is none but 0.
template <int Dim>
Field<double> frame_directions(const RegistrationInput<Dim>& input, const RegistrationOptions& options);

}  // namespace saltus
