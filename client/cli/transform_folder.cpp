#include "client/cli/transform_folder.h"

#include <CLI/CLI.hpp>

#include "core/support/errors.h"

namespace saltus::cli {

namespace fs = std::filesystem;

fs::path displacement_file(const fs::path& transform, TransformDirection direction) {
  if (!fs::is_directory(transform)) {
    if (direction == TransformDirection::Inverse)
      throw InvalidInput("--inverse needs the folder of a registration, but --transform is the file " +
                         transform.string() +
                         "; name the folder, or the file of the inverse displacement without --inverse");
    return transform;
  }
  const std::string name = direction == TransformDirection::Inverse ? "inverse_displacement" : "displacement";
  std::string found, last;
  for (const char* suffix : {".mha", ".nii.gz", ".nii", ".nrrd"}) {
    if (!fs::exists(transform / (name + suffix))) continue;
    found += (found.empty() ? "" : " and ") + name + suffix;
    last = name + suffix;
  }
  // Of two registrations, of which nothing here says which was the last.
  if (found != last)
    throw InvalidInput(
        "--transform is " + transform.string() + ", which holds " + found + "; name one of them with " +
        (direction == TransformDirection::Inverse ? "--transform and leave --inverse out" : "--transform") +
        ", or remove the old one");
  if (!found.empty()) return transform / found;
  if (const fs::path file = transform / "transform.h5"; direction == TransformDirection::Forward && fs::exists(file))
    return file;
  throw FileError(transform.string() + " holds no " + name +
                  " (.mha, .nii.gz, .nii or .nrrd); --transform must be a folder that saltus register wrote");
}

void add_transform_options(CLI::App& command, TransformOptions& options, const char* thing) {
  command
      .add_option("--transform", options.transform,
                  "Folder that saltus register wrote, or a displacement field (an image, or .h5 of ITK)")
      ->type_name("DIR")
      ->required()
      ->check(CLI::ExistingPath);
  command.add_option("--in", options.in, "What is carried through the transform")
      ->type_name(thing)
      ->required()
      ->check(CLI::ExistingFile);
  command.add_option("--out", options.out, "Where the result goes")->type_name(thing)->required();
  command.add_flag("--inverse", options.is_inverse, "Use the inverse transform, from the moving to the fixed image");
}

}  // namespace saltus::cli
