#pragma once

#include "core/registration/register_images.h"

#include <string>
#include <vector>

namespace saltus {

/// A sentence for each image that is constant where its mask shows it: no place in it can be told from another.
template <int Dim>
std::vector<std::string> blank_images(const RegistrationInput<Dim>& input);

}  // namespace saltus
