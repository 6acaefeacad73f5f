#include "client/cli/job_options.h"

#include "client/cli/file_format.h"
#include "core/image_io/points_io.h"
#include "core/image_io/read_image.h"
#include "core/registration/options.h"
#include "core/support/errors.h"

#include <CLI/CLI.hpp>

#include <stdlib.h>
#include <unistd.h>

#include <charconv>
#include <cmath>
#include <filesystem>
#include <iomanip>
#include <sstream>

namespace saltus::cli {
namespace {

template <class Number>
std::optional<Number> parse_number(std::string_view text) {
  Number value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

std::vector<std::string> split(const std::string& text, char separator) {
  std::vector<std::string> parts;
  std::istringstream in(text);
  for (std::string part; std::getline(in, part, separator);) parts.push_back(part);
  if (text.ends_with(separator)) parts.emplace_back();
  return parts;
}

/// "a, b or c".
template <class Value>
std::string alternatives(const std::vector<Value>& values) {
  std::string text;
  for (std::size_t i = 0; i < values.size(); ++i)
    text += (i == 0 ? "" : i + 1 == values.size() ? " or " : ", ") + to_string(values[i]);
  return text;
}

RegistrationOptions chosen_defaults(const JobOptions& options) {
  return default_options(parse_model(options.model), parse_similarity(options.similarity),
                         parse_preset(options.preset));
}

v1::AffineStart parse_affine(const std::string& text) {
  if (text == "none") return v1::AFFINE_START_NONE;
  if (text == "rigid") return v1::AFFINE_START_RIGID;
  if (text == "affine") return v1::AFFINE_START_AFFINE;
  throw InvalidInput("--affine is " + text + "; it must be none, rigid or affine");
}

std::pair<std::string, std::string> parse_setting(const std::string& setting) {
  const auto equals = setting.find('=');
  if (equals == std::string::npos || equals == 0)
    throw InvalidInput("--set is " + setting + "; it must be NAME=VALUE, and --set help lists the names");
  return {setting.substr(0, equals), setting.substr(equals + 1)};
}

void require(const std::string& value, const std::string& option) {
  if (value.empty()) throw InvalidInput(option + " is missing; see --help");
}

}  // namespace

std::vector<std::string> comparable_models() {
  std::vector<std::string> names;
  for (Model model : all_models())
    if (model != Model::Directional) names.push_back(to_string(model));
  return names;
}

void add_job_options(CLI::App& app, JobOptions& options) {
  app.add_option("--fixed", options.fixed, "Image that stays (required)")->type_name("IMAGE")->check(CLI::ExistingFile);
  app.add_option("--moving", options.moving, "Image that is deformed onto it (required)")
      ->type_name("IMAGE")
      ->check(CLI::ExistingFile);
  app.add_option("--model", options.model, alternatives(all_models()))->capture_default_str();
  app.add_option("--similarity", options.similarity, alternatives(all_similarities()))->capture_default_str();
  app.add_option("--preset", options.preset, alternatives(all_presets()))->capture_default_str();
  app.add_option("--fixed-mask", options.fixed_mask, "What is 0 in it counts for nothing; on the fixed image's grid")
      ->type_name("IMAGE")
      ->check(CLI::ExistingFile);
  app.add_option("--moving-mask", options.moving_mask, "The same on the moving image's grid")
      ->type_name("IMAGE")
      ->check(CLI::ExistingFile);
  app.add_option("--affine", options.affine, "Start: none, rigid or affine")->capture_default_str();
  app.add_option("--intensity-window", options.intensity_window, "Clip both images to these intensities")
      ->type_name("LO,HI");
  app.add_option("--crop", options.crop, "Part of the fixed image to register, voxels [begin, end)")
      ->type_name("x0,y0[,z0]:x1,y1[,z1]");
  app.add_option("--set", options.settings, "Expert parameter, may be repeated; --set help lists them")
      ->type_name("NAME=VALUE")
      ->allow_extra_args(false);
  app.add_option("--fixed-points", options.fixed_points, "Landmarks for the report, world mm (LPS), header x,y,z")
      ->type_name("CSV")
      ->check(CLI::ExistingFile);
  app.add_option("--moving-points", options.moving_points, "Their counterparts, row by row")
      ->type_name("CSV")
      ->check(CLI::ExistingFile);
  add_points_format_options(app, options.points_format);
  app.add_option("--allow", options.allowed, "spacing, overlap or points: go on although the inputs look odd in this")
      ->type_name("WHAT")
      ->allow_extra_args(false);
  app.add_option("--format", options.format, "Of the images that are made: mha, nii.gz or nrrd")->capture_default_str();
  app.add_option("--threads", options.threads, "Threads of the solver; 0: as many as the server gives")
      ->type_name("N")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
}

bool wants_parameter_help(const JobOptions& options) {
  return std::find(options.settings.begin(), options.settings.end(), "help") != options.settings.end();
}

std::string parameter_table(const JobOptions& options) {
  const auto parameters = list_parameters(chosen_defaults(options));
  std::array<std::size_t, 4> widths{};
  const auto widen = [&widths](std::initializer_list<std::string> cells) {
    std::size_t column = 0;
    for (const std::string& cell : cells) widths[column] = std::max(widths[column], cell.size()), ++column;
  };
  widen({"name", "value", "unit", "range"});
  for (const ParameterInfo& p : parameters) widen({p.name, p.value, p.unit, p.range});

  std::ostringstream table;
  const auto row = [&](const std::string& name, const std::string& value, const std::string& unit,
                       const std::string& range, const std::string& description) {
    table << std::left << std::setw(static_cast<int>(widths[0]) + 2) << name
          << std::setw(static_cast<int>(widths[1]) + 2) << value << std::setw(static_cast<int>(widths[2]) + 2) << unit
          << std::setw(static_cast<int>(widths[3]) + 2) << range << description << '\n';
  };
  row("name", "value", "unit", "range", "description");
  for (const ParameterInfo& p : parameters) row(p.name, p.value, p.unit, p.range, p.description);
  return table.str();
}

RegistrationOptions chosen_options(const JobOptions& options) {
  RegistrationOptions registration = chosen_defaults(options);
  for (const std::string& setting : options.settings) {
    const auto [name, value] = parse_setting(setting);
    set_parameter(registration, name, value);
  }
  if (const auto found = problems(registration); !found.empty()) throw InvalidInput(found.front());
  return registration;
}

v1::RegistrationSpec make_spec(const JobOptions& options) {
  require(options.fixed, "--fixed");
  require(options.moving, "--moving");
  if (options.fixed_points.empty() != options.moving_points.empty())
    throw InvalidInput("--fixed-points and --moving-points belong together; give both or none");

  v1::RegistrationSpec spec;
  chosen_options(options);  // throws for what the solver does not know
  for (const std::string& setting : options.settings) {
    const auto [name, value] = parse_setting(setting);
    (*spec.mutable_settings())[name] = value;
  }
  spec.set_model(options.model);
  spec.set_similarity(options.similarity);
  spec.set_preset(options.preset);
  spec.set_affine(parse_affine(options.affine));
  if (!options.intensity_window.empty()) {
    const auto [low, high] = parse_intensity_window(options.intensity_window);
    spec.mutable_intensity_window()->set_low(low);
    spec.mutable_intensity_window()->set_high(high);
  }
  if (!options.crop.empty()) {
    const Box box = parse_crop(options.crop);
    spec.mutable_crop()->mutable_begin()->Assign(box.begin.begin(), box.begin.end());
    spec.mutable_crop()->mutable_end()->Assign(box.end.begin(), box.end.end());
  }
  if (options.format != "mha" && options.format != "nii.gz" && options.format != "nrrd")
    throw InvalidInput("--format is " + options.format + "; it must be mha, nii.gz or nrrd");
  spec.set_output_format(options.format);
  spec.set_threads(options.threads);

  // The formats are entered here, so that a bad name is found before anything is sent.
  spec.mutable_fixed()->set_format(image_format("--fixed", options.fixed));
  spec.mutable_moving()->set_format(image_format("--moving", options.moving));
  if (!options.fixed_mask.empty())
    spec.mutable_fixed_mask()->set_format(image_format("--fixed-mask", options.fixed_mask));
  if (!options.moving_mask.empty())
    spec.mutable_moving_mask()->set_format(image_format("--moving-mask", options.moving_mask));
  if (!options.fixed_points.empty()) {
    spec.mutable_fixed_points()->set_format(points_format("--fixed-points", options.fixed_points));
    spec.mutable_moving_points()->set_format(points_format("--moving-points", options.moving_points));
  }
  return spec;
}

namespace {

/// A landmark file in the terms of the protocol, gone when the object goes.
class ConvertedPoints {
 public:
  ConvertedPoints(const PointsFormat& format, const std::string& points, const std::string& image) {
    std::string name = (std::filesystem::temp_directory_path() / "saltus-points-XXXXXX.csv").string();
    const int descriptor = ::mkstemps(name.data(), 4);
    if (descriptor < 0)
      throw FileError("no temporary file can be made in " + std::filesystem::temp_directory_path().string());
    ::close(descriptor);
    file_ = name;
    try {
      if (image_dimension(image) == 2)
        write_points(file_, read_points_as<2>(format, points, read_grid<2>(image)));
      else
        write_points(file_, read_points_as<3>(format, points, read_grid<3>(image)));
    } catch (...) {
      remove();
      throw;
    }
  }
  ~ConvertedPoints() { remove(); }
  ConvertedPoints(const ConvertedPoints&) = delete;
  ConvertedPoints& operator=(const ConvertedPoints&) = delete;

  const std::filesystem::path& file() const { return file_; }

 private:
  void remove() const {
    std::error_code gone_already;
    std::filesystem::remove(file_, gone_already);
  }
  std::filesystem::path file_;
};

}  // namespace

void upload_inputs(client::RegistrationClient& client, const JobOptions& options, v1::RegistrationSpec& spec) {
  const auto upload = [&client](const std::string& file, v1::InputFile* input) {
    *input = client.upload_file(file, input->format());
  };
  const auto upload_points = [&](const std::string& points, const std::string& image, v1::InputFile* input) {
    if (options.points_format.is_default()) return upload(points, input);
    upload(ConvertedPoints(options.points_format, points, image).file(), input);
  };
  upload(options.fixed, spec.mutable_fixed());
  upload(options.moving, spec.mutable_moving());
  if (spec.has_fixed_mask()) upload(options.fixed_mask, spec.mutable_fixed_mask());
  if (spec.has_moving_mask()) upload(options.moving_mask, spec.mutable_moving_mask());
  if (spec.has_fixed_points()) upload_points(options.fixed_points, options.fixed, spec.mutable_fixed_points());
  if (spec.has_moving_points()) upload_points(options.moving_points, options.moving, spec.mutable_moving_points());
}

std::pair<double, double> parse_intensity_window(const std::string& text) {
  const auto parts = split(text, ',');
  if (parts.size() == 2) {
    const auto low = parse_number<double>(parts[0]), high = parse_number<double>(parts[1]);
    if (low && high && std::isfinite(*low) && std::isfinite(*high) && *low < *high) return {*low, *high};
  }
  throw InvalidInput("--intensity-window is " + text + "; it must be LO,HI with LO < HI, e.g. -1000,400");
}

Box parse_crop(const std::string& text) {
  const InvalidInput error("--crop is " + text +
                           "; it must be x0,y0[,z0]:x1,y1[,z1], voxel indices from 0, each end beyond its begin");
  const auto corners = split(text, ':');
  if (corners.size() != 2) throw error;
  const auto indices = [&error](const std::string& corner) {
    std::vector<int> values;
    for (const std::string& part : split(corner, ',')) {
      const auto value = parse_number<int>(part);
      if (!value || *value < 0) throw error;
      values.push_back(*value);
    }
    return values;
  };
  const Box box{indices(corners[0]), indices(corners[1])};
  if (box.begin.size() != box.end.size() || box.begin.size() < 2 || box.begin.size() > 3) throw error;
  for (std::size_t axis = 0; axis < box.begin.size(); ++axis)
    if (box.end[axis] <= box.begin[axis]) throw error;
  return box;
}

}  // namespace saltus::cli
