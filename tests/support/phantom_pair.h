#pragma once

#include "core/phantom/make_phantom.h"
#include "core/registration/register_images.h"

namespace saltus::testing {

/// Both images of a phantom, without masks or an affine start.
template <int Dim>
RegistrationInput<Dim> pair_of(const Phantom<Dim>& phantom) {
  RegistrationInput<Dim> input;
  input.fixed = phantom.fixed;
  input.moving = phantom.moving;
  return input;
}

}  // namespace saltus::testing
