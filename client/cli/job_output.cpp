#include "client/cli/job_output.h"

#include "core/support/errors.h"

#include <google/protobuf/util/time_util.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <iomanip>
#include <sstream>

namespace saltus::cli {
namespace {

std::string without_prefix(const std::string& name, const std::string& prefix) {
  return name.starts_with(prefix) ? name.substr(prefix.size()) : name;
}

std::string lower(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(), [](unsigned char c) { return std::tolower(c); });
  return text;
}

std::string time_text(const google::protobuf::Timestamp& time) {
  google::protobuf::Timestamp seconds;
  seconds.set_seconds(time.seconds());
  return google::protobuf::util::TimeUtil::ToString(seconds);
}

nlohmann::json input_json(const v1::InputFile& input) {
  return {{"digest", input.digest()}, {"format", input.format()}};
}

nlohmann::json spec_json(const v1::RegistrationSpec& spec) {
  nlohmann::json json{{"fixed", input_json(spec.fixed())},
                      {"moving", input_json(spec.moving())},
                      {"model", spec.model()},
                      {"similarity", spec.similarity()},
                      {"preset", spec.preset()},
                      {"settings", nlohmann::json::object()},
                      {"affine", lower(without_prefix(v1::AffineStart_Name(spec.affine()), "AFFINE_START_"))},
                      {"output_format", spec.output_format()},
                      {"threads", spec.threads()}};
  for (const auto& [name, value] : spec.settings()) json["settings"][name] = value;
  if (spec.has_fixed_mask()) json["fixed_mask"] = input_json(spec.fixed_mask());
  if (spec.has_moving_mask()) json["moving_mask"] = input_json(spec.moving_mask());
  if (spec.has_fixed_points()) json["fixed_points"] = input_json(spec.fixed_points());
  if (spec.has_moving_points()) json["moving_points"] = input_json(spec.moving_points());
  if (spec.has_intensity_window())
    json["intensity_window"] = {spec.intensity_window().low(), spec.intensity_window().high()};
  if (spec.has_crop())
    json["crop"] = {{"begin", std::vector<int>(spec.crop().begin().begin(), spec.crop().begin().end())},
                    {"end", std::vector<int>(spec.crop().end().begin(), spec.crop().end().end())}};
  return json;
}

nlohmann::json progress_json(const v1::JobProgress& progress) {
  nlohmann::json json{{"stage", stage_name(progress.stage())},
                      {"level", progress.level()},
                      {"levels", progress.levels()},
                      {"iteration", progress.iteration()},
                      {"max_iterations", progress.max_iterations()},
                      {"energy", progress.energy()},
                      {"similarity", progress.similarity()},
                      {"fraction", progress.fraction()}};
  if (progress.seconds_left() >= 0) json["seconds_left"] = progress.seconds_left();
  if (progress.checkpoints() > 0) json["checkpoints"] = progress.checkpoints();
  if (progress.is_resumed()) json["is_resumed"] = true;
  if (progress.memory_bytes() > 0) json["memory_bytes"] = progress.memory_bytes();
  if (progress.cpu_seconds() > 0) json["cpu_seconds"] = progress.cpu_seconds();
  if (!progress.waiting_for().empty()) json["waiting_for"] = progress.waiting_for();
  return json;
}

std::string priority_name(v1::JobPriority priority) {
  return lower(without_prefix(v1::JobPriority_Name(priority), "JOB_PRIORITY_"));
}

nlohmann::json resources_json(const v1::JobResources& resources) {
  nlohmann::json json = nlohmann::json::object();
  const auto add = [&json](const char* name, std::int64_t value) {
    if (value > 0) json[name] = value;
  };
  add("memory_bytes", resources.memory_bytes());
  add("memory_bytes_limit", resources.memory_bytes_limit());
  add("wall_seconds_limit", resources.wall_seconds_limit());
  add("cpu_seconds_limit", resources.cpu_seconds_limit());
  return json;
}

}  // namespace

std::string state_name(v1::JobState state) { return without_prefix(v1::JobState_Name(state), "JOB_STATE_"); }

v1::JobState parse_state(const std::string& text) {
  std::string allowed;
  for (int number = v1::JOB_STATE_QUEUED; number <= v1::JOB_STATE_CANCELLED; ++number) {
    const auto state = static_cast<v1::JobState>(number);
    if (lower(state_name(state)) == lower(text)) return state;
    allowed += (allowed.empty() ? "" : ", ") + lower(state_name(state));
  }
  throw InvalidInput("--state is " + text + "; it must be one of " + allowed);
}

std::string stage_name(v1::JobStage stage) {
  if (stage == v1::JOB_STAGE_UNSPECIFIED) return "starting";
  return lower(without_prefix(v1::JobStage_Name(stage), "JOB_STAGE_"));
}

nlohmann::json job_json(const v1::RegistrationJob& job) {
  nlohmann::json json{{"id", job.id()}, {"state", state_name(job.state())}, {"attempt", job.attempt()}};
  json["spec"] = spec_json(job.spec());
  if (!job.labels().empty())
    for (const auto& [name, value] : job.labels()) json["labels"][name] = value;
  if (job.has_progress()) json["progress"] = progress_json(job.progress());
  if (job.has_failure()) json["failure"] = {{"reason", job.failure().reason()}, {"message", job.failure().message()}};
  if (job.state() == v1::JOB_STATE_SUCCEEDED) {
    json["artifacts"] = nlohmann::json::array();
    for (const auto& artifact : job.artifacts())
      json["artifacts"].push_back(
          {{"name", artifact.name()}, {"digest", artifact.digest()}, {"size", artifact.size()}});
  }
  if (job.has_create_time()) json["create_time"] = time_text(job.create_time());
  if (job.has_start_time()) json["start_time"] = time_text(job.start_time());
  if (job.has_begin_time()) json["begin_time"] = time_text(job.begin_time());
  if (job.has_end_time()) json["end_time"] = time_text(job.end_time());
  if (!job.batch_id().empty()) json["batch_id"] = job.batch_id();
  if (job.state() == v1::JOB_STATE_QUEUED) json["queue_position"] = job.queue_position();
  if (job.has_estimated_start_time()) json["estimated_start_time"] = time_text(job.estimated_start_time());
  if (job.has_not_before()) json["not_before"] = time_text(job.not_before());
  if (!job.submitter().empty()) json["submitter"] = job.submitter();
  if (job.priority() != v1::JOB_PRIORITY_UNSPECIFIED) json["priority"] = priority_name(job.priority());
  if (job.has_resources()) json["resources"] = resources_json(job.resources());
  if (job.has_last_loss())
    json["last_loss"] = {{"reason", job.last_loss().reason()}, {"message", job.last_loss().message()}};
  if (job.has_checkpoint())
    json["checkpoint"] = {{"attempt", job.checkpoint().attempt()},
                          {"level", job.checkpoint().level()},
                          {"iteration", job.checkpoint().iteration()}};
  return json;
}

std::string job_text(const v1::RegistrationJob& job) {
  std::ostringstream text;
  const auto line = [&text](const std::string& name, const auto& value) {
    text << std::left << std::setw(12) << name + ":" << value << '\n';
  };
  line("id", job.id());
  line("state", state_name(job.state()));
  if (job.state() == v1::JOB_STATE_QUEUED) line("position", job.queue_position());
  if (job.has_estimated_start_time()) line("starts", "about " + time_text(job.estimated_start_time()));
  if (job.state() == v1::JOB_STATE_RUNNING) line("stage", stage_name(job.progress().stage()));
  if (!job.progress().waiting_for().empty()) line("waits for", job.progress().waiting_for());
  line("attempt", job.attempt());
  if (job.has_last_loss()) line("lost", job.last_loss().reason() + ": " + job.last_loss().message());
  if (job.priority() == v1::JOB_PRIORITY_LOW || job.priority() == v1::JOB_PRIORITY_HIGH)
    line("priority", priority_name(job.priority()));
  for (const auto& [name, value] : job.labels()) line("label", name + "=" + value);
  line("model", job.spec().model());
  line("similarity", job.spec().similarity());
  line("preset", job.spec().preset());
  for (const auto& [name, value] : job.spec().settings()) line("set", name + "=" + value);
  if (job.has_create_time()) line("created", time_text(job.create_time()));
  if (job.has_start_time()) line("started", time_text(job.start_time()));
  if (job.has_begin_time()) line("began", time_text(job.begin_time()));
  if (!job.batch_id().empty()) line("batch id", job.batch_id());
  if (job.has_end_time()) line("ended", time_text(job.end_time()));
  if (job.has_failure()) line("failure", job.failure().reason() + ": " + job.failure().message());
  for (const auto& artifact : job.artifacts())
    line("artifact", artifact.name() + " (" + std::to_string(artifact.size()) + " bytes)");
  return text.str();
}

std::string job_table(const std::vector<v1::RegistrationJob>& jobs) {
  std::size_t id_width = 2;
  for (const auto& job : jobs) id_width = std::max(id_width, job.id().size());
  std::ostringstream table;
  const auto row = [&](const auto& id, const auto& state, const auto& done, const auto& created, const auto& what) {
    table << std::left << std::setw(static_cast<int>(id_width) + 2) << id << std::setw(12) << state << std::setw(7)
          << done << std::setw(22) << created << what << '\n';
  };
  row("ID", "STATE", "DONE", "CREATED", "WHAT");
  for (const auto& job : jobs) {
    std::string done = "-";
    if (job.state() == v1::JOB_STATE_SUCCEEDED) done = "100 %";
    if (job.state() == v1::JOB_STATE_RUNNING)
      done = std::to_string(std::lround(100 * job.progress().fraction())) + " %";
    row(job.id(), state_name(job.state()), done, time_text(job.create_time()),
        job.spec().model() + " " + job.spec().similarity() + " " + job.spec().preset());
  }
  return table.str();
}

std::string failure_line(const v1::RegistrationJob& job) {
  if (job.state() == v1::JOB_STATE_CANCELLED) return "job " + job.id() + " was cancelled";
  return "job " + job.id() + " failed (" + job.failure().reason() + "): " + job.failure().message();
}

}  // namespace saltus::cli
