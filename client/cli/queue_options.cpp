#include "client/cli/queue_options.h"

#include "core/image_io/read_image.h"
#include "core/registration/options.h"
#include "core/registration/register_images.h"
#include "core/support/errors.h"

#include <CLI/CLI.hpp>

#include <cmath>
#include <cstdint>

namespace saltus::cli {
namespace {

constexpr double kGibibyte = 1 << 30;
constexpr double kMinute = 60;

v1::JobPriority parse_priority(const std::string& text) {
  if (text == "low") return v1::JOB_PRIORITY_LOW;
  if (text == "normal") return v1::JOB_PRIORITY_NORMAL;
  if (text == "high") return v1::JOB_PRIORITY_HIGH;
  throw InvalidInput("--priority is " + text + "; it must be low, normal or high");
}

template <int Dim>
std::int64_t estimate(const JobOptions& job) {
  ImageGrid<Dim> fixed = read_grid<Dim>(job.fixed);
  // A box that does not fit the image is refused where the image is read.
  if (!job.crop.empty()) {
    const Box box = parse_crop(job.crop);
    for (std::size_t axis = 0; axis < Dim && axis < box.begin.size(); ++axis)
      fixed.size[axis] = std::min(fixed.size[axis], box.end[axis] - box.begin[axis]);
  }
  RegistrationOptions options = chosen_options(job);
  return static_cast<std::int64_t>(memory_estimate(fixed, read_grid<Dim>(job.moving), options));
}

}  // namespace

void add_queue_options(CLI::App& app, QueueOptions& options) {
  app.add_option("--priority", options.priority, "low, normal or high: high ones start first")->capture_default_str();
  app.add_option("--label", options.labels, "To find the job by, may be repeated")
      ->type_name("NAME=VALUE")
      ->allow_extra_args(false);
  app.add_option("--memory", options.memory, "What the job needs; it starts when so much is free [from the images]")
      ->type_name("GIB")
      ->check(CLI::NonNegativeNumber);
  app.add_option("--memory-limit", options.memory_limit, "The job fails when it takes more [none]")
      ->type_name("GIB")
      ->check(CLI::NonNegativeNumber);
  app.add_option("--wall-time", options.wall_time, "The job fails when it runs for longer [none]")
      ->type_name("MINUTES")
      ->check(CLI::NonNegativeNumber);
  app.add_option("--cpu-time", options.cpu_time, "The job fails when all its threads together take more [none]")
      ->type_name("MINUTES")
      ->check(CLI::NonNegativeNumber);
}

std::map<std::string, std::string> parse_labels(const std::vector<std::string>& labels) {
  std::map<std::string, std::string> parsed;
  for (const std::string& label : labels) {
    const auto equals = label.find('=');
    if (equals == std::string::npos || equals == 0)
      throw InvalidInput("--label is " + label + "; it must be NAME=VALUE");
    if (!parsed.emplace(label.substr(0, equals), label.substr(equals + 1)).second)
      throw InvalidInput("--label is " + label + " beside another of that name; give each name once");
  }
  return parsed;
}

v1::CreateRegistrationJobRequest make_request(const QueueOptions& options, const JobOptions& job) {
  v1::CreateRegistrationJobRequest request;
  request.set_priority(parse_priority(options.priority));
  for (const auto& [name, value] : parse_labels(options.labels)) (*request.mutable_labels())[name] = value;
  v1::JobResources& resources = *request.mutable_resources();
  const auto bytes = [](double gibibytes) { return static_cast<std::int64_t>(std::ceil(gibibytes * kGibibyte)); };
  const auto seconds = [](double minutes) { return static_cast<std::int64_t>(std::ceil(minutes * kMinute)); };
  if (options.memory > 0)
    resources.set_memory_bytes(bytes(options.memory));
  else
    resources.set_memory_bytes(image_dimension(job.fixed) == 2 ? estimate<2>(job) : estimate<3>(job));
  resources.set_memory_bytes_limit(bytes(options.memory_limit));
  resources.set_wall_seconds_limit(seconds(options.wall_time));
  resources.set_cpu_seconds_limit(seconds(options.cpu_time));
  return request;
}

}  // namespace saltus::cli
