// Registers two 3-D image files in this process: NIfTI, MetaImage or NRRD in, displacement and registered image out.
// Usage: register_files FIXED MOVING FOLDER
#include "core/image_io/read_image.h"
#include "core/image_io/write_image.h"
#include "core/registration/register_images.h"

#include <filesystem>
#include <iostream>
#include <stdexcept>

int main(int argument_count, char** arguments) try {
  using namespace saltus;
  if (argument_count != 4) throw std::invalid_argument("usage: register_files FIXED MOVING FOLDER");
  RegistrationInput<3> input;
  input.fixed = read_volume<3>(arguments[1]);
  input.moving = read_volume<3>(arguments[2]);
  const RegistrationOptions options = default_options(Model::Auto, SimilarityType::Lncc, Preset::Balanced);
  const RegistrationResult<3> result = register_images(input, options);

  const std::filesystem::path folder(arguments[3]);
  std::filesystem::create_directories(folder);
  write_vector_volume(folder / "displacement.nii.gz", result.displacement);  // fixed(x) ~ moving(x + u(x)), mm, LPS
  write_volume(folder / "warped.nii.gz", result.warped);
  std::cout << "dissimilarity " << result.summary.similarity_before << " -> " << result.summary.similarity_after
            << ", smallest Jacobian " << result.summary.min_jacobian << '\n';
} catch (const std::exception& error) {  // InvalidInput and FileError say what to do in one sentence
  std::cerr << error.what() << '\n';
  return 1;
}
