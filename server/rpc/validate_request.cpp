#include "server/rpc/validate_request.h"

#include "core/registration/options.h"
#include "core/support/errors.h"
#include "server/rpc/invalid_field.h"
#include "server/rpc/limits.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <sstream>
#include <string_view>

namespace saltus::server {
namespace {

constexpr std::string_view kHexDigits = "0123456789abcdef";
constexpr std::string_view kPlainName = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-";
constexpr std::string_view kIdCharacters = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-";
constexpr std::size_t kShownBytes = 80;
constexpr std::size_t kWordBytes = 128;
constexpr int kLongestWaitSeconds = 60;
const std::vector<std::string> kImageFormats = {"mha", "nii", "nii.gz", "nrrd", "png"};
const std::vector<std::string> kOutputFormats = {"mha", "nii.gz", "nrrd"};
const std::vector<std::string> kPointFormats = {"csv"};

/// `text` in a form that fits into any header and terminal.
std::string shown(std::string_view text) {
  std::string result = "'";
  for (const char c : text.substr(0, kShownBytes)) result += c >= ' ' && c <= '~' ? c : '?';
  result += text.size() > kShownBytes ? "...'" : "'";
  return result;
}

[[noreturn]] void refuse(const std::string& field, const std::string& value, const std::string& way_out) {
  throw InvalidField(field, field + " is " + value + "; " + way_out);
}

std::string joined(const std::vector<std::string>& words) {
  std::string result;
  for (const std::string& word : words) result += (result.empty() ? "" : ", ") + word;
  return result;
}

std::string shown_number(double value) {
  std::ostringstream text;
  text << value;
  return text.str();
}

bool is_plain(std::string_view text) { return text.find_first_not_of(kPlainName) == std::string_view::npos; }

bool is_printable(std::string_view text) {
  return std::all_of(text.begin(), text.end(), [](char c) { return c >= ' ' && c <= '~'; });
}

/// Names and numbers: short and printable, so that they can be quoted in an answer.
void check_word(const std::string& field, const std::string& value) {
  if (value.size() > kWordBytes || !is_printable(value))
    refuse(field, shown(value), "it must be at most " + std::to_string(kWordBytes) + " printable ASCII characters");
}

void check_digest(const std::string& field, const std::string& digest) {
  const std::string_view text = digest;
  const bool is_well_formed = text.size() == 71 && text.starts_with("sha256:") &&
                              text.substr(7).find_first_not_of(kHexDigits) == std::string_view::npos;
  if (!is_well_formed) refuse(field, shown(digest), "it must be sha256: and 64 lower-case hex digits");
}

void check_upload(const std::string& digest, std::int64_t size, const std::string& upload_id) {
  check_digest("digest", digest);
  if (size < 0 || size > limits::kBlobBytes)
    refuse("size", std::to_string(size), "it must be 0 to " + std::to_string(limits::kBlobBytes) + " bytes");
  if (upload_id.size() > limits::kUploadIdBytes || upload_id.find_first_not_of(kIdCharacters) != std::string::npos)
    refuse("upload_id", shown(upload_id),
           "it must have at most " + std::to_string(limits::kUploadIdBytes) + " letters, digits, '-' and '_'");
}

void check_file(const std::string& field, const v1::InputFile& file, const std::vector<std::string>& formats) {
  check_digest(field + ".digest", file.digest());
  if (std::find(formats.begin(), formats.end(), file.format()) == formats.end())
    refuse(field + ".format", shown(file.format()),
           "it must be " + std::string(formats.size() > 1 ? "one of " : "") + joined(formats));
}

void check_inputs(const v1::RegistrationSpec& spec) {
  if (!spec.has_fixed()) throw InvalidInput("spec.fixed is not set; upload the fixed image and give its digest");
  if (!spec.has_moving()) throw InvalidInput("spec.moving is not set; upload the moving image and give its digest");
  check_file("spec.fixed", spec.fixed(), kImageFormats);
  check_file("spec.moving", spec.moving(), kImageFormats);
  if (spec.has_fixed_mask()) check_file("spec.fixed_mask", spec.fixed_mask(), kImageFormats);
  if (spec.has_moving_mask()) check_file("spec.moving_mask", spec.moving_mask(), kImageFormats);
  if (spec.has_fixed_points() != spec.has_moving_points())
    throw InvalidInput(std::string(spec.has_fixed_points() ? "spec.moving_points" : "spec.fixed_points") +
                       " is not set although its partner is; give both point files or none");
  if (spec.has_fixed_points()) {
    check_file("spec.fixed_points", spec.fixed_points(), kPointFormats);
    check_file("spec.moving_points", spec.moving_points(), kPointFormats);
  }
}

void check_parameters(const v1::RegistrationSpec& spec) {
  check_word("spec.model", spec.model());
  check_word("spec.similarity", spec.similarity());
  check_word("spec.preset", spec.preset());
  const RegistrationOptions defaults;
  RegistrationOptions options =
      default_options(spec.model().empty() ? defaults.model : parse_model(spec.model()),
                      spec.similarity().empty() ? defaults.similarity : parse_similarity(spec.similarity()),
                      spec.preset().empty() ? defaults.preset : parse_preset(spec.preset()));
  if (spec.settings_size() > limits::kSettings)
    refuse("spec.settings", "a list of " + std::to_string(spec.settings_size()),
           "at most " + std::to_string(limits::kSettings) + " are allowed");
  for (const auto& [name, value] : spec.settings()) {
    check_word("a name in spec.settings", name);
    check_word("spec.settings[" + name + "]", value);
    set_parameter(options, name, value);
  }
  if (const auto found = problems(options); !found.empty()) throw InvalidInput(found.front());
  if (!v1::AffineStart_IsValid(spec.affine()))
    refuse("spec.affine", std::to_string(static_cast<int>(spec.affine())), "it must be none, rigid or affine");
  if (spec.threads() < 0 || spec.threads() > limits::kThreads)
    refuse("spec.threads", std::to_string(spec.threads()),
           "it must be 0 (the daemon's default) to " + std::to_string(limits::kThreads));
}

void check_window(const v1::IntensityWindow& window) {
  if (!std::isfinite(window.low()) || !std::isfinite(window.high()) || !(window.low() < window.high()))
    refuse("spec.intensity_window", shown_number(window.low()) + "," + shown_number(window.high()),
           "low must be less than high, and both must be finite");
}

void check_crop(const v1::CropBox& crop) {
  const auto text = [](const auto& indices) {
    std::string result;
    for (const int index : indices) {
      result += result.empty() ? "[" : ",";
      result += std::to_string(index);
    }
    result += result.empty() ? "[]" : "]";
    return result;
  };
  const std::string value = crop.begin_size() > 3 || crop.end_size() > 3
                                ? "a box of " + std::to_string(std::max(crop.begin_size(), crop.end_size())) + " axes"
                                : text(crop.begin()) + " to " + text(crop.end());
  if (crop.begin_size() != crop.end_size() || crop.begin_size() < 2 || crop.begin_size() > 3)
    refuse("spec.crop", value, "begin and end must both have 2 or both have 3 indices");
  for (int axis = 0; axis < crop.begin_size(); ++axis)
    if (crop.begin(axis) < 0 || crop.begin(axis) >= crop.end(axis))
      refuse("spec.crop", value, "begin must be at least 0 and less than end on every axis");
}

void check_labels(const google::protobuf::Map<std::string, std::string>& labels) {
  if (static_cast<int>(labels.size()) > limits::kLabels)
    refuse("labels", "a list of " + std::to_string(labels.size()),
           "at most " + std::to_string(limits::kLabels) + " are allowed");
  for (const auto& [name, value] : labels) {
    if (name.empty() || name.size() > limits::kLabelNameBytes || !is_plain(name))
      refuse("a name in labels", shown(name),
             "it must have 1 to " + std::to_string(limits::kLabelNameBytes) + " letters, digits, '.', '_' or '-'");
    if (value.size() > limits::kLabelValueBytes)
      refuse("labels[" + name + "]", "a text of " + std::to_string(value.size()) + " bytes",
             "it must have at most " + std::to_string(limits::kLabelValueBytes));
  }
}

void check_number(const std::string& field, std::int64_t value, std::int64_t most) {
  if (value < 0 || value > most)
    refuse(field, std::to_string(value), "it must be 0 (not said) to " + std::to_string(most));
}

void check_scheduling(const v1::CreateRegistrationJobRequest& request) {
  if (!v1::JobPriority_IsValid(request.priority()))
    refuse("priority", std::to_string(static_cast<int>(request.priority())), "it must be low, normal or high");
  const v1::JobResources& resources = request.resources();
  check_number("resources.memory_bytes", resources.memory_bytes(), limits::kMemoryBytes);
  check_number("resources.memory_bytes_limit", resources.memory_bytes_limit(), limits::kMemoryBytes);
  check_number("resources.wall_seconds_limit", resources.wall_seconds_limit(), limits::kLimitSeconds);
  check_number("resources.cpu_seconds_limit", resources.cpu_seconds_limit(), limits::kLimitSeconds);
}

}  // namespace

const std::vector<std::string>& image_formats() { return kImageFormats; }

void validate(const v1::CreateRegistrationJobRequest& request) {
  if (request.request_id().size() > limits::kRequestIdBytes || !is_printable(request.request_id()))
    refuse("request_id", shown(request.request_id()),
           "it must have at most " + std::to_string(limits::kRequestIdBytes) + " printable ASCII characters");
  check_labels(request.labels());
  check_scheduling(request);
  if (!request.has_spec()) throw InvalidInput("spec is not set; say which images to register");
  const v1::RegistrationSpec& spec = request.spec();
  check_inputs(spec);
  check_parameters(spec);
  if (spec.has_intensity_window()) check_window(spec.intensity_window());
  if (spec.has_crop()) check_crop(spec.crop());
  if (!spec.output_format().empty() &&
      std::find(kOutputFormats.begin(), kOutputFormats.end(), spec.output_format()) == kOutputFormats.end())
    refuse("spec.output_format", shown(spec.output_format()), "it must be one of " + joined(kOutputFormats));
}

void validate(const v1::BatchCreateRegistrationJobsRequest& request) {
  if (request.requests_size() < 1 || request.requests_size() > limits::kBatchJobs)
    refuse("requests", "a list of " + std::to_string(request.requests_size()),
           "it must have 1 to " + std::to_string(limits::kBatchJobs) + " jobs");
  for (int i = 0; i < request.requests_size(); ++i) {
    try {
      validate(request.requests(i));
    } catch (const InvalidField& error) {
      const std::string place = "requests[" + std::to_string(i) + "]";
      throw InvalidField(place + "." + error.field(), place + ": " + error.what());
    } catch (const InvalidInput& error) {
      const std::string place = "requests[" + std::to_string(i) + "]";
      throw InvalidField(place, place + ": " + error.what());
    }
  }
}

void validate(const v1::ListRegistrationJobsRequest& request) {
  if (request.page_size() < 0)
    refuse("page_size", std::to_string(request.page_size()),
           "it must be 0 (for " + std::to_string(limits::kDefaultPage) + ") or more");
  if (!v1::JobState_IsValid(request.state()))
    refuse("state", std::to_string(static_cast<int>(request.state())), "it must be a JobState, or unspecified for all");
  check_labels(request.labels());
  check_word("submitter", request.submitter());
}

void validate(const v1::FindMissingBlobsRequest& request) {
  if (request.digests_size() > limits::kDigestsPerCall)
    refuse("digests", "a list of " + std::to_string(request.digests_size()),
           "at most " + std::to_string(limits::kDigestsPerCall) + " are allowed in one call");
  for (const std::string& digest : request.digests()) check_digest("digests", digest);
}

void validate(const v1::ReadBlobRequest& request) {
  check_digest("digest", request.digest());
  if (request.offset() < 0) refuse("offset", std::to_string(request.offset()), "it must be 0 or more");
}

void validate_upload(const v1::WriteBlobRequest& first) {
  check_upload(first.digest(), first.size(), first.upload_id());
  if (first.write_offset() < 0 || first.write_offset() > first.size())
    refuse("write_offset", std::to_string(first.write_offset()),
           "it must be 0 to the size, " + std::to_string(first.size()));
  if (first.write_offset() > 0 && first.upload_id().empty())
    refuse("write_offset", std::to_string(first.write_offset()),
           "only an upload with an upload_id can be continued; begin at 0");
}

void validate(const v1::QueryWriteStatusRequest& request) {
  check_upload(request.digest(), request.size(), request.upload_id());
}

void validate_job_id(const std::string& id) {
  if (id.empty() || id.size() > kWordBytes || !is_plain(id))
    refuse("id", shown(id), "it must be the id of a job, as CreateRegistrationJob answered it");
}

void validate(const v1::AcquireLeaseRequest& request) {
  const std::string& worker = request.worker();
  if (worker.size() > kWordBytes || (!worker.empty() && !is_plain(worker)))
    refuse(
        "worker", shown(worker),
        "it must be a name of at most " + std::to_string(kWordBytes) + " letters, digits, '-', '_' and '.', or empty");
}

void validate(const v1::TakeJobRequest& request) {
  if (request.threads() < 1) refuse("threads", std::to_string(request.threads()), "it must be at least 1");
  if (request.memory_bytes() < 0)
    refuse("memory_bytes", std::to_string(request.memory_bytes()), "it must be 0 or more");
  const double wait = request.wait_seconds();
  // Written so that what is no number is refused too.
  if (!(wait >= 0 && wait <= kLongestWaitSeconds))
    refuse("wait_seconds", std::to_string(wait), "it must be 0 to " + std::to_string(kLongestWaitSeconds));
  if (request.worker().size() > kWordBytes || !is_printable(request.worker()))
    refuse("worker", shown(request.worker()),
           "it must be at most " + std::to_string(kWordBytes) + " printable ASCII characters");
}

void validate(const v1::PutCheckpointRequest& request) {
  check_digest("checkpoint.digest", request.checkpoint().digest());
  if (request.checkpoint().size() <= 0)
    refuse("checkpoint.size", std::to_string(request.checkpoint().size()), "it must be the size of the blob");
}

void validate(const v1::CompleteJobRequest& request) {
  if (request.has_failure()) {
    const v1::JobFailure& failure = request.failure();
    check_word("failure.reason", failure.reason());
    if (failure.reason().empty()) throw InvalidInput("failure.reason is ''; it must be a word such as DIVERGED");
    if (failure.message().size() > limits::kStringBytes)
      refuse("failure.message", "a text of " + std::to_string(failure.message().size()) + " bytes",
             "it must have at most " + std::to_string(limits::kStringBytes));
  }
  if (!request.has_success()) return;
  if (request.success().artifacts_size() > limits::kArtifacts)
    refuse("success.artifacts", "a list of " + std::to_string(request.success().artifacts_size()),
           "at most " + std::to_string(limits::kArtifacts) + " are allowed");
  std::set<std::string> names;
  for (const v1::Artifact& artifact : request.success().artifacts()) {
    // Clients make files of these names.
    if (artifact.name().empty() || artifact.name().size() > kWordBytes || artifact.name().front() == '.' ||
        !is_plain(artifact.name()))
      refuse("success.artifacts.name", shown(artifact.name()),
             "it must be a plain file name of letters, digits, '.', '_' and '-' that does not begin with '.'");
    if (!names.insert(artifact.name()).second)
      refuse("success.artifacts.name", shown(artifact.name()), "each name must occur once");
    check_digest("success.artifacts.digest", artifact.digest());
  }
}

}  // namespace saltus::server
