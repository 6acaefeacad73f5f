// Registers two images in this process and scores the result: the numerics alone, neither files nor a daemon.
#include "core/evaluation/field_error.h"
#include "core/evaluation/statistics.h"
#include "core/phantom/make_phantom.h"
#include "core/registration/register_images.h"

#include <iostream>

int main() {
  using namespace saltus;
  // A pair whose halves slide along each other by 10 mm, with the true displacement. Your own: Volume<2 or 3>.
  const Phantom<2> pair = make_phantom<2>(default_phantom_options(PhantomKind::Rectangle, 2));
  RegistrationInput<2> input;
  input.fixed = pair.fixed;
  input.moving = pair.moving;

  RegistrationOptions options = default_options(Model::Sliding, SimilarityType::Ssd, Preset::Fast);
  set_parameter(options, "max_iterations", "60");  // every name that `saltus register --set help` lists
  const auto show = [](const Progress& now) {
    std::cerr << "\rlevel " << now.level << '/' << now.levels << ", iteration " << now.iteration << "  ";
    return ProgressAnswer::Continue;
  };
  const RegistrationResult<2> result = register_images(input, options, show);

  const auto errors = endpoint_errors<2>(result.displacement, pair.displacement, pair.masks.valid);
  const Statistics error = summarise(errors);
  std::cout << "\nerror " << error.mean << " mm, mean of " << error.n
            << " voxels; ended: " << to_string(result.summary.termination) << '\n';
  return error.mean < 1 ? 0 : 1;
}
