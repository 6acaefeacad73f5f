#include "client/cli/warp_command.h"

#include <CLI/CLI.hpp>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "client/cli/command.h"
#include "client/cli/transform_folder.h"
#include "core/evaluation/warp_image.h"
#include "core/image_io/image_format.h"
#include "core/image_io/read_image.h"
#include "core/image_io/read_transform.h"
#include "core/image_io/write_image.h"
#include "core/support/errors.h"

namespace saltus::cli {
namespace {

struct WarpCommandOptions {
  TransformOptions transform;
  std::string interpolation = "linear";
  std::optional<float> outside;
  bool as_json = false;
};

template <int Dim>
int carry_image(const WarpCommandOptions& options, const std::filesystem::path& displacement) {
  const WarpOptions how{.interpolation = parse_interpolation(options.interpolation), .outside = options.outside};
  const Volume<Dim> image = read_volume<Dim>(options.transform.in);
  write_volume(options.transform.out, warp_image(image, read_displacement<Dim>(displacement), how));
  if (options.as_json)
    std::cout << nlohmann::json{{"written", options.transform.out}}.dump(2) << std::endl;
  else
    std::cout << "written to " << options.transform.out << std::endl;
  return Done;
}

int carry_image_of_any_dimension(const WarpCommandOptions& options) {
  parse_interpolation(options.interpolation);
  format_from_suffix(options.transform.out);
  const auto displacement = options.transform.displacement();
  const int dimension = displacement_dimension(displacement);
  if (const int given = image_dimension(options.transform.in); given != dimension)
    throw InvalidInput("--in is " + options.transform.in + ", a " + std::to_string(given) +
                       "-D image, but the transform is " + std::to_string(dimension) +
                       "-D; both must have the same dimension");
  return dimension == 2 ? carry_image<2>(options, displacement) : carry_image<3>(options, displacement);
}

}  // namespace

void add_warp_command(CLI::App& app, int& exit_code) {
  CLI::App* command = app.add_subcommand("warp", "Carry an image through a transform");
  auto options = std::make_shared<WarpCommandOptions>();
  add_transform_options(*command, options->transform, "IMAGE");
  command->add_option("--interpolation", options->interpolation, "linear, nearest (for labels) or bspline")
      ->capture_default_str();
  command->add_option("--outside", options->outside, "Value of points beyond the image; default: its border's value")
      ->type_name("VALUE");
  command->add_flag("--json", options->as_json, "Print what was done as JSON");
  command->footer(
      "An image on the moving side comes to the fixed image's grid; with --inverse the other way round.\n"
      "Examples:\n"
      "  saltus warp --transform result --in moving_dose.mha --out dose_on_fixed.mha\n"
      "  saltus warp --transform result --in moving_labels.nii.gz --out labels.nii.gz --interpolation nearest");
  command->callback([options, &exit_code] { exit_code = carry_image_of_any_dimension(*options); });
}

}  // namespace saltus::cli
