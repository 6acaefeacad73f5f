#include "client/cli/points_command.h"

#include <CLI/CLI.hpp>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/cli/command.h"
#include "client/cli/input_check.h"
#include "client/cli/points_format.h"
#include "client/cli/transform_folder.h"
#include "core/evaluation/field_sampling.h"
#include "core/image_io/points_io.h"
#include "core/image_io/read_transform.h"
#include "core/support/errors.h"

namespace saltus::cli {
namespace {

struct PointsCommandOptions {
  TransformOptions transform;
  PointsFormat format;
  bool is_allowed = false;  ///< points outside of the image
  bool as_json = false;
};

/// Throws InvalidInput when most of the points are elsewhere.
template <int Dim>
void require_in_image(const std::vector<Vector<Dim>>& points, const ImageGrid<Dim>& grid,
                      const PointsCommandOptions& options) {
  const TransformOptions& transform = options.transform;
  PointsPlace<Dim> place{"--in", transform.is_inverse ? "moving image" : "fixed image", grid};
  place.format = options.format;
  if (points_suspicion(points, place).empty()) return;
  const auto other_way = transform.is_inverse ? TransformDirection::Forward : TransformDirection::Inverse;
  try {
    place.other = read_displacement<Dim>(displacement_file(transform.transform, other_way)).grid;
    place.other_way = transform.is_inverse ? "they lie in the fixed image: leave --inverse out"
                                           : "they lie in the moving image: add --inverse";
  } catch (const std::exception&) {
    // A transform of one direction only says nothing about the other image; what is odd is told all the same.
  }
  throw InvalidInput(points_suspicion(points, place) + " If it is meant so, add --allow-outside.");
}

template <int Dim>
int carry_points(const PointsCommandOptions& options, const std::filesystem::path& file) {
  const TransformOptions& transform = options.transform;
  const VectorVolume<Dim> displacement = read_displacement<Dim>(file);
  const auto points = read_points_as<Dim>(options.format, transform.in, displacement.grid);
  if (!options.is_allowed) require_in_image(points, displacement.grid, options);
  const auto moved = transform_points(displacement, points);
  write_points(transform.out, in_space_of(options.format, moved));
  if (options.as_json)
    std::cout << nlohmann::json{{"points", points.size()}, {"written", transform.out}}.dump(2) << std::endl;
  else
    std::cout << points.size() << " points written to " << transform.out << std::endl;
  return Done;
}

}  // namespace

void add_points_command(CLI::App& app, int& exit_code) {
  CLI::App* command = app.add_subcommand("points", "Carry landmarks through a transform");
  auto options = std::make_shared<PointsCommandOptions>();
  add_transform_options(*command, options->transform, "P.csv");
  add_points_format_options(*command, options->format);
  command->add_flag("--allow-outside", options->is_allowed, "Go on although most points lie outside of their image");
  command->add_flag("--json", options->as_json, "Print what was done as JSON");
  command->footer(
      "Landmarks are CSV with the header x,y,z (x,y in 2-D), world mm (LPS). Points of the fixed image become points\n"
      "of the moving image; with --inverse the other way round. Beyond the field its border's displacement is used.\n"
      "The result is in mm, in the axes of --points-space.\n"
      "Examples:\n"
      "  saltus points --transform result --in fixed.csv --out where_in_moving.csv\n"
      "  saltus points --transform result --in slicer.csv --points-space ras --inverse --out in_fixed.csv");
  command->callback([options, &exit_code] {
    const auto displacement = options->transform.displacement();
    exit_code = displacement_dimension(displacement) == 2 ? carry_points<2>(*options, displacement)
                                                          : carry_points<3>(*options, displacement);
  });
}

}  // namespace saltus::cli
