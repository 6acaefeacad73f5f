#pragma once

#include "client/cli/job_options.h"

#include "saltus/v1/registration.pb.h"

#include <map>
#include <string>
#include <vector>

namespace CLI {
class App;
}

namespace saltus::cli {

/// What `submit` is told about the place of a job among others, as it stands on the command line.
struct QueueOptions {
  std::string priority = "normal";
  std::vector<std::string> labels = {};  ///< NAME=VALUE each
  double memory = 0;                     ///< GiB; 0: an estimate from the images
  double memory_limit = 0;               ///< GiB; 0: none
  double wall_time = 0;                  ///< minutes; 0: none
  double cpu_time = 0;                   ///< minutes; 0: none
};

void add_queue_options(CLI::App& app, QueueOptions& options);

/// Everything of the request but its specification. Reads the headers of the images to tell what memory the job needs.
/// Throws InvalidInput that names the option, and FileError.
v1::CreateRegistrationJobRequest make_request(const QueueOptions& options, const JobOptions& job);

/// "NAME=VALUE" each, every name once. Throws InvalidInput.
std::map<std::string, std::string> parse_labels(const std::vector<std::string>& labels);

}  // namespace saltus::cli
