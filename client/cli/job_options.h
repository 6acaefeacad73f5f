#pragma once

#include "client/cli/points_format.h"
#include "client/lib/registration_client.h"
#include "core/registration/options.h"

#include <array>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace CLI {
class App;
}

namespace saltus::cli {

/// What `register` and `submit` are told about a job, as it stands on the command line.
struct JobOptions {
  std::string fixed, moving;
  std::string fixed_mask, moving_mask;      ///< "" for none
  std::string fixed_points, moving_points;  ///< "" for none
  PointsFormat points_format;
  std::vector<std::string> allowed;  ///< suspicions that are no reason to stop, see input_check.h
  std::string model = "auto";
  std::string similarity = "lncc";
  std::string preset = "balanced";
  std::string affine = "none";
  std::string intensity_window;       ///< "LO,HI" or ""
  std::string crop;                   ///< "x0,y0[,z0]:x1,y1[,z1]" or ""
  std::vector<std::string> settings;  ///< NAME=VALUE each, or the one word "help"
  std::string format = "nii.gz";
  int threads = 0;
};

/// The models that can run on any pair, as the command line names them: all but `directional`, which has to be told
/// along which direction motion jumps.
std::vector<std::string> comparable_models();

void add_job_options(CLI::App& app, JobOptions& options);

/// True when the user asks with --set help what the parameters are.
bool wants_parameter_help(const JobOptions& options);

/// The table of expert parameters with their values for the chosen model, similarity and preset.
/// Throws InvalidInput for a name that does not exist.
std::string parameter_table(const JobOptions& options);

/// The solver's options that `options` stands for. Throws InvalidInput that names the option.
RegistrationOptions chosen_options(const JobOptions& options);

/// The job as the protocol wants it, but without its input files. Everything that can be known without a daemon and
/// without reading an image is checked here. Throws InvalidInput that names the option.
v1::RegistrationSpec make_spec(const JobOptions& options);

/// Sends the input files and enters them in `spec`. Landmarks that are not world mm (LPS) are sent as such.
void upload_inputs(client::RegistrationClient& client, const JobOptions& options, v1::RegistrationSpec& spec);

/// "LO,HI" -> numbers, LO < HI. Throws InvalidInput.
std::pair<double, double> parse_intensity_window(const std::string& text);

struct Box {
  std::vector<int> begin, end;  ///< two or three each, [begin, end), not empty
};
/// "x0,y0[,z0]:x1,y1[,z1]" -> half-open box of voxel indices. Throws InvalidInput.
Box parse_crop(const std::string& text);

}  // namespace saltus::cli
