#pragma once

#include <filesystem>
#include <string>

namespace CLI {
class App;
}

namespace saltus::cli {

/// Forward: fixed points become moving points, moving images come to the fixed grid. Inverse: the other way round.
enum class TransformDirection { Forward, Inverse };

/// The displacement field that `transform` names: the file itself, or in a folder made by `saltus register` its
/// displacement or inverse_displacement (.mha, .nii.gz, .nii or .nrrd), or, forward, its transform.h5 when only that is
/// there; read_displacement reads them all. Throws FileError when there is none, and InvalidInput when there is one in
/// more than one format, or when `direction` is Inverse and `transform` is a file, since its inverse is not known.
std::filesystem::path displacement_file(const std::filesystem::path& transform, TransformDirection direction);

/// What points and warp share.
struct TransformOptions {
  std::string transform;
  std::string in;
  std::string out;
  bool is_inverse = false;

  std::filesystem::path displacement() const {
    return displacement_file(transform, is_inverse ? TransformDirection::Inverse : TransformDirection::Forward);
  }
};

/// Adds --transform, --in, --out and --inverse; `thing` names what goes in and out, e.g. "IMAGE".
void add_transform_options(CLI::App& command, TransformOptions& options, const char* thing);

}  // namespace saltus::cli
