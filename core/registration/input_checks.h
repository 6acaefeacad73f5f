#pragma once

#include "core/registration/register_images.h"

namespace saltus {

/// Throws InvalidInput, naming what is wrong, when a registration of `input` cannot start: sizes, values that are not
/// finite, masks that do not fit or show nothing, a singular affine start, images that do not overlap.
template <int Dim>
void check_input(const RegistrationInput<Dim>& input);

}  // namespace saltus
