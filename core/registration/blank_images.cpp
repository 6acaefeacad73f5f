#include "core/registration/blank_images.h"

#include <sstream>

namespace saltus {

template <int Dim>
std::vector<std::string> blank_images(const RegistrationInput<Dim>& input) {
  std::vector<std::string> found;
  const auto look = [&](const char* what, const Volume<Dim>& image, const std::optional<Volume<Dim>>& mask) {
    const float* first = nullptr;
    for (std::size_t i = 0; i < image.samples.size(); ++i) {
      if (mask && !(mask->samples[i] > 0)) continue;
      if (!first) first = &image.samples[i];
      if (image.samples[i] != *first) return;
    }
    std::ostringstream text;
    text << what << " image is " << *first << " everywhere" << (mask ? " in its mask" : "")
         << "; nothing in it shows where anything belongs, so nothing was moved";
    found.push_back(text.str());
  };
  look("fixed", input.fixed, input.fixed_mask);
  look("moving", input.moving, input.moving_mask);
  return found;
}

template std::vector<std::string> blank_images(const RegistrationInput<2>&);
template std::vector<std::string> blank_images(const RegistrationInput<3>&);

}  // namespace saltus
