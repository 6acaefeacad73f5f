#include "client/cli/evaluate_command.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <iomanip>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/cli/command.h"
#include "client/cli/input_check.h"
#include "client/cli/points_format.h"
#include "client/cli/statistics_json.h"
#include "client/cli/transform_folder.h"
#include "core/evaluation/field_error.h"
#include "core/evaluation/grid_agreement.h"
#include "core/evaluation/jacobian.h"
#include "core/evaluation/label_overlap.h"
#include "core/evaluation/warp_image.h"
#include "core/image_io/points_io.h"
#include "core/image_io/read_image.h"
#include "core/image_io/read_transform.h"
#include "core/support/errors.h"

namespace saltus::cli {
namespace {

struct EvaluateOptions {
  std::string transform;
  std::string fixed_points, moving_points;
  std::string fixed_labels, moving_labels;
  std::string truth;
  std::vector<std::string> masks;
  PointsFormat points_format;
  bool is_allowed = false;  ///< points outside of the image
  bool as_json = false;
};

/// What lies in all masks.
template <int Dim>
std::optional<Volume<Dim>> read_masks(const std::vector<std::string>& files) {
  std::optional<Volume<Dim>> all;
  for (const std::string& file : files) {
    Volume<Dim> mask = read_volume<Dim>(file);
    if (!all) {
      all = std::move(mask);
      continue;
    }
    require_same_grid(files.front(), all->grid, file, mask.grid);
    for (std::size_t i = 0; i < mask.samples.size(); ++i)
      all->samples[i] = all->samples[i] > 0 && mask.samples[i] > 0 ? 1.0f : 0.0f;
  }
  return all;
}

template <int Dim>
nlohmann::json score(const EvaluateOptions& options, const std::filesystem::path& file) {
  const VectorVolume<Dim> displacement = read_displacement<Dim>(file);
  nlohmann::json result;
  result["finite"] = std::all_of(displacement.samples.begin(), displacement.samples.end(),
                                 [](float value) { return std::isfinite(value); });
  if (!options.fixed_points.empty()) {
    PointsPlace<Dim> place{"--fixed-points", "fixed image", displacement.grid};
    place.format = options.points_format;
    ImageGrid<Dim> moving_grid = displacement.grid;
    // Only voxel indices need to know where the moving image is.
    if (options.points_format.unit == "voxel")
      moving_grid = read_displacement<Dim>(displacement_file(options.transform, TransformDirection::Inverse)).grid;
    const auto fixed = read_points_as<Dim>(options.points_format, options.fixed_points, displacement.grid);
    const auto moving = read_points_as<Dim>(options.points_format, options.moving_points, moving_grid);
    if (const std::string suspicion = points_suspicion(fixed, place); !suspicion.empty() && !options.is_allowed)
      throw InvalidInput(suspicion + " If it is meant so, add --allow-outside.");
    result["tre_before_mm"] = as_json(summarise(landmark_distances<Dim>(fixed, moving)));
    result["tre_mm"] = as_json(summarise(landmark_errors(displacement, fixed, moving)));
  }
  if (!options.truth.empty()) {
    const auto truth = read_vector_volume<Dim>(options.truth);
    const auto mask = read_masks<Dim>(options.masks);
    result["epe_before_mm"] = as_json(summarise(endpoint_errors(VectorVolume<Dim>(displacement.grid), truth, mask)));
    result["epe_mm"] = as_json(summarise(endpoint_errors(displacement, truth, mask)));
  }
  if (!options.fixed_labels.empty()) {
    // A label map may have a grid of its own: what counts is its place in the world.
    const WarpOptions nearest{.interpolation = Interpolation::Nearest, .outside = 0.0f};
    const VectorVolume<Dim> at_rest(displacement.grid);
    const auto moving = read_volume<Dim>(options.moving_labels);
    const auto fixed = warp_image(read_volume<Dim>(options.fixed_labels), at_rest, nearest);
    const auto before = label_overlaps(fixed, warp_image(moving, at_rest, nearest));
    const auto after = label_overlaps(fixed, warp_image(moving, displacement, nearest));
    auto list = [](const std::vector<LabelOverlap>& overlaps) {
      nlohmann::json labels = nlohmann::json::object();
      double sum = 0;
      for (const LabelOverlap& overlap : overlaps) {
        labels[std::to_string(overlap.label)] = overlap.dice;
        sum += overlap.dice;
      }
      return nlohmann::json{{"mean", sum / static_cast<double>(overlaps.size())}, {"labels", labels}};
    };
    result["dice_before"] = list(before);
    result["dice"] = list(after);
  }
  const JacobianStatistics jacobian = jacobian_statistics(jacobian_determinant(displacement));
  result["jacobian"] = {{"min", jacobian.min},
                        {"max", jacobian.max},
                        {"share_not_positive", jacobian.share_not_positive},
                        {"sd_log", jacobian.sd_log}};
  return result;
}

void print_table(const nlohmann::json& result) {
  std::cout << std::fixed << std::setprecision(3);
  if (!result.at("finite").get<bool>()) std::cout << "The displacement holds values that are not finite.\n";
  const std::pair<const char*, const char*> rows[] = {{"landmarks before, mm", "tre_before_mm"},
                                                      {"landmarks after, mm", "tre_mm"},
                                                      {"field before, mm", "epe_before_mm"},
                                                      {"field after, mm", "epe_mm"}};
  if (result.contains("tre_mm") || result.contains("epe_mm")) {
    std::cout << std::left << std::setw(22) << "" << std::right;
    for (const char* column : {"n", "mean", "sd", "median", "p90", "max"}) std::cout << std::setw(10) << column;
    std::cout << '\n';
  }
  for (const auto& [title, key] : rows) {
    if (!result.contains(key)) continue;
    const nlohmann::json& row = result.at(key);
    std::cout << std::left << std::setw(22) << title << std::right << std::setw(10) << row.at("n").get<std::size_t>();
    for (const char* column : {"mean", "sd", "median", "p90", "max"})
      std::cout << std::setw(10) << row.at(column).get<double>();
    std::cout << '\n';
  }
  if (result.contains("dice")) {
    std::cout << "Dice " << result.at("/dice_before/mean"_json_pointer).get<double>() << " -> "
              << result.at("/dice/mean"_json_pointer).get<double>() << " (mean of "
              << result.at("/dice/labels"_json_pointer).size() << " labels)\n";
    for (const auto& [label, dice] : result.at("/dice/labels"_json_pointer).items())
      std::cout << "  label " << label << ": " << dice.get<double>() << '\n';
  }
  const nlohmann::json& jacobian = result.at("jacobian");
  std::cout << "Jacobian " << jacobian.at("min").get<double>() << " to " << jacobian.at("max").get<double>() << ", "
            << 100 * jacobian.at("share_not_positive").get<double>() << " % not positive, sd of log "
            << jacobian.at("sd_log").get<double>() << std::endl;
}

void require_both(const std::string& name, const std::string& fixed, const std::string& moving) {
  if (fixed.empty() == moving.empty()) return;
  const std::string given = fixed.empty() ? "--moving-" : "--fixed-",
                    missing = fixed.empty() ? "--fixed-" : "--moving-";
  throw InvalidInput(given + name + " is given without " + missing + name + "; both are needed");
}

int evaluate(const EvaluateOptions& options) {
  require_both("points", options.fixed_points, options.moving_points);
  require_both("labels", options.fixed_labels, options.moving_labels);
  if (!options.masks.empty() && options.truth.empty())
    throw InvalidInput("--mask is given without --truth; it says where the error against the truth counts");
  const auto displacement = displacement_file(options.transform, TransformDirection::Forward);
  const nlohmann::json result =
      displacement_dimension(displacement) == 2 ? score<2>(options, displacement) : score<3>(options, displacement);
  if (options.as_json) {
    std::cout << result.dump(1) << std::endl;
  } else {
    print_table(result);
  }
  return Done;
}

}  // namespace

void add_evaluate_command(CLI::App& app, int& exit_code) {
  CLI::App* command = app.add_subcommand("evaluate", "Score a transform against landmarks, labels or a true field");
  auto options = std::make_shared<EvaluateOptions>();
  auto add_file = [command](const char* name, auto& value, const char* description) {
    return command->add_option(name, value, description)->check(CLI::ExistingFile);
  };
  command
      ->add_option("--transform", options->transform,
                   "Folder that saltus register wrote, or a displacement field (an image, or .h5 of ITK)")
      ->type_name("DIR")
      ->required()
      ->check(CLI::ExistingPath);
  add_file("--fixed-points", options->fixed_points, "Landmarks of the fixed image")->type_name("P.csv");
  add_file("--moving-points", options->moving_points, "The same landmarks in the moving image, row by row")
      ->type_name("Q.csv");
  add_points_format_options(*command, options->points_format);
  command->add_flag("--allow-outside", options->is_allowed, "Go on although most points lie outside of the image");
  add_file("--fixed-labels", options->fixed_labels, "Label map of the fixed image, on any grid")->type_name("IMAGE");
  add_file("--moving-labels", options->moving_labels, "Label map of the moving image")->type_name("IMAGE");
  add_file("--truth", options->truth, "True displacement on the fixed grid")->type_name("FIELD");
  add_file("--mask", options->masks, "Where the error against the truth counts; given twice, where both do")
      ->type_name("IMAGE");
  command->add_flag("--json", options->as_json, "Print JSON");
  command->footer(
      "Errors are mm: mean, sd, median, 90th percentile and maximum. The Jacobian is that of central differences "
      "inside\n"
      "the image, which bridge a sliding interface.\n"
      "Examples:\n"
      "  saltus evaluate --transform result --fixed-points fixed.csv --moving-points moving.csv\n"
      "  saltus evaluate --transform result --truth slip/truth.mha --mask slip/mask_valid.mha --json");
  command->callback([options, &exit_code] { exit_code = evaluate(*options); });
}

}  // namespace saltus::cli
