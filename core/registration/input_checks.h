#pragma once

#include "core/registration/register_images.h"

namespace saltus {

/// Share of a voxel by which the places of two grids may differ: some formats keep their header in single precision.
constexpr double kSamePlace = 0.05;

/// Throws InvalidInput, naming what is wrong, when a registration of `input` cannot start: sizes, values that are not
/// finite, masks that do not fit or show nothing, a singular affine start, images that do not overlap.
template <int Dim>
void check_input(const RegistrationInput<Dim>& input);

}  // namespace saltus
