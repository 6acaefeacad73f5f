#include "client/cli/points_command.h"

#include <CLI/CLI.hpp>
#include <iostream>
#include <memory>

#include "client/cli/command.h"
#include "client/cli/transform_folder.h"
#include "core/evaluation/field_sampling.h"
#include "core/image_io/points_io.h"
#include "core/image_io/read_transform.h"

namespace saltus::cli {
namespace {

template <int Dim>
int carry_points(const TransformOptions& options, const std::filesystem::path& displacement) {
  const auto points = read_points<Dim>(options.in);
  write_points(options.out, transform_points(read_displacement<Dim>(displacement), points));
  std::cout << points.size() << " points written to " << options.out << std::endl;
  return Done;
}

}  // namespace

void add_points_command(CLI::App& app, int& exit_code) {
  CLI::App* command = app.add_subcommand("points", "Carry landmarks through a transform");
  auto options = std::make_shared<TransformOptions>();
  add_transform_options(*command, *options, "P.csv");
  command->footer(
      "Landmarks are CSV with the header x,y,z (x,y in 2-D), world mm (LPS). Points of the fixed image become points\n"
      "of the moving image; with --inverse the other way round. Beyond the field its border's displacement is used.\n"
      "Example:\n"
      "  saltus points --transform result --in fixed.csv --out where_in_moving.csv");
  command->callback([options, &exit_code] {
    const auto displacement = options->displacement();
    exit_code = displacement_dimension(displacement) == 2 ? carry_points<2>(*options, displacement)
                                                          : carry_points<3>(*options, displacement);
  });
}

}  // namespace saltus::cli
