#include "client/cli/phantom_command.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <vector>

#include "client/cli/command.h"
#include "core/image_io/points_io.h"
#include "core/image_io/write_image.h"
#include "core/phantom/make_phantom.h"
#include "core/support/errors.h"

namespace saltus::cli {
namespace {

namespace fs = std::filesystem;

/// What was said on the command line; what was not keeps the kind's default.
struct PhantomCommandOptions {
  std::string kind;
  std::optional<int> dimension;
  std::vector<int> size;
  std::vector<double> spacing;
  std::optional<std::string> interface, texture;
  std::optional<double> angle, radius, slip, rotation, displacement, noise;
  std::optional<std::uint64_t> seed;
  std::string out;
  std::string format = "mha";
  bool as_json = false;
};

void refuse_unused(bool is_given, bool is_used, const std::string& option, const std::string& kind) {
  if (is_given && !is_used)
    throw InvalidInput(option + " has no meaning for the phantom " + kind +
                       "; leave it out (see saltus phantom --help)");
}

PhantomOptions phantom_options(const PhantomCommandOptions& given) {
  const PhantomKind kind = parse_phantom_kind(given.kind);
  auto is = [kind](auto... kinds) { return ((kind == kinds) || ...); };
  using enum PhantomKind;
  refuse_unused(given.interface.has_value(), is(Slip), "--interface", given.kind);
  refuse_unused(given.texture.has_value(), is(Rectangle, Wheel), "--texture", given.kind);
  refuse_unused(given.angle.has_value(), is(Rectangle, Slip), "--angle", given.kind);
  refuse_unused(given.radius.has_value(), is(Wheel, Slip), "--radius", given.kind);
  refuse_unused(given.slip.has_value(), is(Rectangle, Slip), "--slip", given.kind);
  refuse_unused(given.rotation.has_value(), is(Wheel), "--rotation", given.kind);
  refuse_unused(given.displacement.has_value(), is(Thorax, Smooth), "--displacement", given.kind);

  const int axes = given.size.empty() ? given.dimension.value_or(0) : static_cast<int>(given.size.size());
  if (!given.size.empty() && given.dimension && axes != *given.dimension)
    throw InvalidInput("--size has " + std::to_string(axes) + " numbers but --dimension is " +
                       std::to_string(*given.dimension) + "; give one number per dimension");
  PhantomOptions options = default_phantom_options(kind, axes);
  std::copy(given.size.begin(), given.size.end(), options.size.begin());
  if (given.spacing.size() == 1) {
    options.spacing.fill(given.spacing.front());
  } else if (!given.spacing.empty()) {
    if (static_cast<int>(given.spacing.size()) != options.dimension)
      throw InvalidInput("--spacing has " + std::to_string(given.spacing.size()) + " numbers; give one, or " +
                         std::to_string(options.dimension) + " separated by commas");
    std::copy(given.spacing.begin(), given.spacing.end(), options.spacing.begin());
  }
  if (given.interface) options.interface = parse_interface_shape(*given.interface);
  refuse_unused(kind == Slip && given.angle && options.interface == InterfaceShape::Circle, false, "--angle",
                "slip with a circle");
  refuse_unused(kind == Slip && given.radius && options.interface == InterfaceShape::Line, false, "--radius",
                "slip with a line");
  if (given.texture) options.texture = parse_texture_kind(*given.texture);
  options.angle_deg = given.angle.value_or(options.angle_deg);
  options.radius_mm = given.radius.value_or(options.radius_mm);
  options.slip_mm = given.slip.value_or(options.slip_mm);
  options.rotation_deg = given.rotation.value_or(options.rotation_deg);
  options.displacement_mm = given.displacement.value_or(options.displacement_mm);
  options.noise = given.noise.value_or(options.noise);
  options.seed = given.seed.value_or(options.seed);
  if (const auto found = problems(options); !found.empty()) throw InvalidInput(found.front());
  return options;
}

template <int Dim>
nlohmann::json description(const PhantomOptions& options, const Phantom<Dim>& phantom) {
  const ImageGrid<Dim>& grid = phantom.fixed.grid;
  nlohmann::json json{{"kind", to_string(options.kind)},
                      {"size", grid.size},
                      {"spacing_mm", std::vector<double>(grid.spacing.begin(), grid.spacing.end())},
                      {"origin_mm", std::vector<double>(grid.origin.begin(), grid.origin.end())},
                      {"noise", options.noise},
                      {"noise_sd", phantom.noise_sd},
                      {"seed", options.seed},
                      {"landmarks", phantom.fixed_points.size()},
                      {"largest_displacement_mm", phantom.largest_displacement_mm},
                      {"convention", "fixed(x) = moving(x + truth(x)), world mm (LPS)"}};
  switch (options.kind) {
    case PhantomKind::Slip:
      json["interface"] = to_string(options.interface);
      json["slip_mm"] = options.slip_mm;
      if (options.interface == InterfaceShape::Circle) {
        json["radius_mm"] = options.radius_mm;
      } else {
        json["angle_deg"] = options.angle_deg;
      }
      break;
    case PhantomKind::Rectangle:
      json["slip_mm"] = options.slip_mm;
      json["angle_deg"] = options.angle_deg;
      json["texture"] = to_string(options.texture);
      break;
    case PhantomKind::Wheel:
      json["radius_mm"] = options.radius_mm;
      json["rotation_deg"] = options.rotation_deg;
      json["texture"] = to_string(options.texture);
      break;
    case PhantomKind::Thorax:
      json["displacement_mm"] = options.displacement_mm;
      json["intensity"] = "HU; lung tissue keeps its mass, so fixed + 1000 = (moving + 1000) det D(x + truth(x)) there";
      json["labels"] = {
          {"1", "right lung"}, {"2", "left lung"}, {"3", "right abdomen"}, {"4", "left abdomen"}, {"5", "bone"}};
      break;
    case PhantomKind::Smooth:
      json["displacement_mm"] = options.displacement_mm;
      break;
  }
  return json;
}

template <int Dim>
int write_phantom(const PhantomOptions& options, const PhantomCommandOptions& given) {
  const fs::path folder = given.out;
  const std::string& format = given.format;
  const Phantom<Dim> phantom = make_phantom<Dim>(options);
  fs::create_directories(folder);
  auto file = [&](const std::string& name) { return folder / (name + "." + format); };
  write_volume(file("fixed"), phantom.fixed);
  write_volume(file("moving"), phantom.moving);
  write_vector_volume(file("truth"), phantom.displacement);
  write_vector_volume(file("inverse_truth"), phantom.inverse_displacement);
  write_labels(file("mask_valid"), phantom.masks.valid);
  write_labels(file("mask_near"), phantom.masks.near);
  write_labels(file("mask_inside"), phantom.masks.inside);
  write_labels(file("mask_outside"), phantom.masks.outside);
  write_labels(file("fixed_labels"), phantom.fixed_labels);
  write_labels(file("moving_labels"), phantom.moving_labels);
  write_points(folder / "fixed_points.csv", phantom.fixed_points);
  write_points(folder / "moving_points.csv", phantom.moving_points);
  std::ofstream json(folder / "phantom.json");
  json << description(options, phantom).dump(2) << '\n';
  json.close();
  if (!json) throw FileError((folder / "phantom.json").string() + " could not be written");
  if (given.as_json)
    std::cout << description(options, phantom).dump(2) << std::endl;
  else
    std::cout << to_string(options.kind) << ", motion up to " << phantom.largest_displacement_mm << " mm, "
              << phantom.fixed_points.size() << " landmarks, written to " << folder.string() << std::endl;
  return Done;
}

int make(const PhantomCommandOptions& given) {
  if (given.format != "mha" && given.format != "nii.gz" && given.format != "nrrd")
    throw InvalidInput("--format is " + given.format + "; it must be mha, nii.gz or nrrd");
  const PhantomOptions options = phantom_options(given);
  return options.dimension == 2 ? write_phantom<2>(options, given) : write_phantom<3>(options, given);
}

}  // namespace

void add_phantom_command(CLI::App& app, int& exit_code) {
  CLI::App* command = app.add_subcommand("phantom", "Make a pair of images with known motion between them");
  auto given = std::make_shared<PhantomCommandOptions>();
  command->add_option("kind", given->kind, "rectangle, wheel, slip, thorax or smooth")->required();
  command->add_option("--out", given->out, "Folder for the phantom, made if need be")->type_name("DIR")->required();
  command->add_option("--dimension", given->dimension, "2 or 3 (rectangle, slip, smooth)");
  command->add_option("--size", given->size, "Voxels per axis, e.g. 128,128")->delimiter(',')->type_name("N,N[,N]");
  command->add_option("--spacing", given->spacing, "mm per voxel, one for all axes or one each")
      ->delimiter(',')
      ->type_name("MM[,MM,MM]");
  command->add_option("--interface", given->interface, "slip: line or circle (default line)");
  command->add_option("--angle", given->angle, "rectangle, slip: degrees from x towards y (default 0)");
  command->add_option("--radius", given->radius, "wheel, slip with a circle: mm (default 59, 36)");
  command->add_option("--slip", given->slip, "rectangle, slip: jump at the interface, mm (default 10, 6)");
  command->add_option("--rotation", given->rotation, "wheel: degrees each way (default 5)");
  command->add_option("--displacement", given->displacement, "thorax, smooth: largest motion, mm (default 20, 8)");
  command->add_option("--texture", given->texture, "rectangle, wheel: plain or blobs (default plain)");
  command->add_option("--noise", given->noise, "sd of the noise, as a share of the intensity range");
  command->add_option("--seed", given->seed, "Of texture, vessels, landmarks and noise (default 1)");
  command->add_option("--format", given->format, "mha, nii.gz or nrrd")->capture_default_str();
  command->add_flag("--json", given->as_json, "Print what was made as JSON");
  command->footer(
      "Written: fixed, moving, truth (displacement on the fixed grid, mm, LPS), inverse_truth, mask_valid (where "
      "errors\n"
      "count), mask_near (within 3 voxels of the interface), mask_inside, mask_outside, fixed_labels, moving_labels,\n"
      "fixed_points.csv, moving_points.csv, phantom.json.\n"
      "Examples:\n"
      "  saltus phantom rectangle --out toy\n"
      "  saltus phantom slip --angle 27 --slip 8 --noise 0.05 --seed 3 --out slip27\n"
      "  saltus phantom thorax --size 256,256,94 --spacing 0.97,0.97,2.5 --out thorax");
  command->callback([given, &exit_code] { exit_code = make(*given); });
}

}  // namespace saltus::cli
