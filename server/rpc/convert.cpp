#include "server/rpc/convert.h"

#include "core/support/errors.h"

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>

#include <stdexcept>

namespace saltus::server {
namespace {

/// Maps in a fixed order, unlike the default.
std::string stable_bytes(const google::protobuf::Message& message) {
  std::string bytes;
  {
    google::protobuf::io::StringOutputStream stream(&bytes);
    google::protobuf::io::CodedOutputStream coded(&stream);
    coded.SetSerializationDeterministic(true);
    if (!message.SerializeToCodedStream(&coded)) throw std::runtime_error("a message cannot be serialised");
  }
  return bytes;
}

v1::RegistrationSpec parse_spec(const std::string& bytes) {
  v1::RegistrationSpec spec;
  if (!spec.ParseFromString(bytes)) throw std::runtime_error("a stored specification cannot be parsed");
  return spec;
}

void set_time(const WallTime& time, google::protobuf::Timestamp& message) {
  const auto milliseconds = time.time_since_epoch().count();
  message.set_seconds(milliseconds / 1000);
  message.set_nanos(static_cast<int>(milliseconds % 1000) * 1000000);
}

double seconds(std::chrono::milliseconds time) { return std::chrono::duration<double>(time).count(); }

v1::JobStage to_message(JobStage stage) {
  switch (stage) {
    case JobStage::Unknown:
      return v1::JOB_STAGE_UNSPECIFIED;
    case JobStage::Waiting:
      return v1::JOB_STAGE_WAITING;
    case JobStage::Fetching:
      return v1::JOB_STAGE_FETCHING;
    case JobStage::Validating:
      return v1::JOB_STAGE_VALIDATING;
    case JobStage::Optimising:
      return v1::JOB_STAGE_OPTIMISING;
    case JobStage::Writing:
      return v1::JOB_STAGE_WRITING;
  }
  return v1::JOB_STAGE_UNSPECIFIED;
}

JobStage from_message(v1::JobStage stage) {
  switch (stage) {
    case v1::JOB_STAGE_FETCHING:
      return JobStage::Fetching;
    case v1::JOB_STAGE_VALIDATING:
      return JobStage::Validating;
    case v1::JOB_STAGE_OPTIMISING:
      return JobStage::Optimising;
    case v1::JOB_STAGE_WRITING:
      return JobStage::Writing;
    default:
      return JobStage::Unknown;
  }
}

v1::JobPriority to_priority(int priority) {
  return priority <= kLowestPriority    ? v1::JOB_PRIORITY_LOW
         : priority >= kHighestPriority ? v1::JOB_PRIORITY_HIGH
                                        : v1::JOB_PRIORITY_NORMAL;
}

int from_priority(v1::JobPriority priority) {
  switch (priority) {
    case v1::JOB_PRIORITY_LOW:
      return kLowestPriority;
    case v1::JOB_PRIORITY_HIGH:
      return kHighestPriority;
    default:
      return kDefaultPriority;
  }
}

void set_failure(const JobFailure& failure, v1::JobFailure& message) {
  message.set_reason(failure.reason);
  message.set_message(failure.message);
}

void set_resources(const JobRecord& job, v1::JobResources& message) {
  message.set_memory_bytes(job.memory_bytes);
  message.set_wall_seconds_limit(job.limits.wall_seconds);
  message.set_cpu_seconds_limit(job.limits.cpu_seconds);
  message.set_memory_bytes_limit(job.limits.memory_bytes);
}

}  // namespace

v1::JobState to_message(JobState state) {
  switch (state) {
    case JobState::Queued:
      return v1::JOB_STATE_QUEUED;
    case JobState::Running:
      return v1::JOB_STATE_RUNNING;
    case JobState::Cancelling:
      return v1::JOB_STATE_CANCELLING;
    case JobState::Succeeded:
      return v1::JOB_STATE_SUCCEEDED;
    case JobState::Failed:
      return v1::JOB_STATE_FAILED;
    case JobState::Cancelled:
      return v1::JOB_STATE_CANCELLED;
  }
  return v1::JOB_STATE_UNSPECIFIED;
}

std::optional<JobState> from_message(v1::JobState state) {
  switch (state) {
    case v1::JOB_STATE_QUEUED:
      return JobState::Queued;
    case v1::JOB_STATE_RUNNING:
      return JobState::Running;
    case v1::JOB_STATE_CANCELLING:
      return JobState::Cancelling;
    case v1::JOB_STATE_SUCCEEDED:
      return JobState::Succeeded;
    case v1::JOB_STATE_FAILED:
      return JobState::Failed;
    case v1::JOB_STATE_CANCELLED:
      return JobState::Cancelled;
    default:
      return std::nullopt;
  }
}

v1::JobProgress to_message(const JobProgress& progress) {
  v1::JobProgress message;
  message.set_stage(to_message(progress.stage));
  message.set_level(progress.level);
  message.set_levels(progress.levels);
  message.set_iteration(progress.iteration);
  message.set_max_iterations(progress.max_iterations);
  message.set_energy(progress.energy);
  message.set_similarity(progress.similarity);
  message.set_fraction(progress.fraction);
  message.set_seconds_left(progress.seconds_left);
  message.set_checkpoints(progress.checkpoints);
  message.set_is_resumed(progress.is_resumed);
  message.set_memory_bytes(progress.memory_bytes);
  message.set_cpu_seconds(progress.cpu_seconds);
  message.set_waiting_for(progress.waiting_for);
  return message;
}

JobProgress from_message(const v1::JobProgress& message) {
  JobProgress progress;
  progress.stage = from_message(message.stage());
  progress.level = message.level();
  progress.levels = message.levels();
  progress.iteration = message.iteration();
  progress.max_iterations = message.max_iterations();
  progress.energy = message.energy();
  progress.similarity = message.similarity();
  progress.fraction = message.fraction();
  progress.seconds_left = message.seconds_left();
  progress.checkpoints = message.checkpoints();
  progress.is_resumed = message.is_resumed();
  progress.memory_bytes = message.memory_bytes();
  progress.cpu_seconds = message.cpu_seconds();
  return progress;
}

v1::RegistrationJob to_message(const JobView& view) {
  const JobRecord& job = view.job;
  v1::RegistrationJob message;
  message.set_id(job.id);
  *message.mutable_spec() = parse_spec(job.spec);
  message.mutable_labels()->insert(job.labels.begin(), job.labels.end());
  message.set_state(to_message(job.state));
  if (view.progress) *message.mutable_progress() = to_message(*view.progress);
  message.set_attempt(job.attempt);
  if (job.failure) set_failure(*job.failure, *message.mutable_failure());
  for (const Artifact& artifact : job.artifacts) {
    auto* added = message.add_artifacts();
    added->set_name(artifact.name);
    added->set_digest(artifact.digest);
    added->set_size(artifact.size);
  }
  set_time(job.created, *message.mutable_create_time());
  if (job.started) set_time(*job.started, *message.mutable_start_time());
  if (job.ended) set_time(*job.ended, *message.mutable_end_time());
  message.set_queue_position(view.queue_position);
  message.set_submitter(job.submitter);
  message.set_priority(to_priority(job.priority));
  if (job.memory_bytes > 0 || job.limits != JobLimits{}) set_resources(job, *message.mutable_resources());
  if (job.last_loss) set_failure(*job.last_loss, *message.mutable_last_loss());
  if (job.not_before) set_time(*job.not_before, *message.mutable_not_before());
  if (view.estimated_start) set_time(*view.estimated_start, *message.mutable_estimated_start_time());
  if (job.checkpoint) {
    message.mutable_checkpoint()->set_attempt(job.checkpoint->attempt);
    message.mutable_checkpoint()->set_level(job.checkpoint->level);
    message.mutable_checkpoint()->set_iteration(job.checkpoint->iteration);
  }
  message.set_batch_id(job.batch_id);
  if (job.begun) set_time(*job.begun, *message.mutable_begin_time());
  return message;
}

NewJob from_message(const v1::CreateRegistrationJobRequest& request, std::string& content) {
  v1::CreateRegistrationJobRequest without_id = request;
  without_id.clear_request_id();
  content = stable_bytes(without_id);

  NewJob job;
  job.request_id = request.request_id();
  job.spec = stable_bytes(request.spec());
  job.labels.insert(request.labels().begin(), request.labels().end());
  job.threads = request.spec().threads();
  job.priority = from_priority(request.priority());
  job.memory_bytes = request.resources().memory_bytes();
  job.limits.wall_seconds = request.resources().wall_seconds_limit();
  job.limits.cpu_seconds = request.resources().cpu_seconds_limit();
  job.limits.memory_bytes = request.resources().memory_bytes_limit();
  const v1::RegistrationSpec& spec = request.spec();
  const auto add = [&](bool is_set, const v1::InputFile& file) {
    if (is_set) job.inputs.push_back(file.digest());
  };
  add(spec.has_fixed(), spec.fixed());
  add(spec.has_moving(), spec.moving());
  add(spec.has_fixed_mask(), spec.fixed_mask());
  add(spec.has_moving_mask(), spec.moving_mask());
  add(spec.has_fixed_points(), spec.fixed_points());
  add(spec.has_moving_points(), spec.moving_points());
  return job;
}

JobFilter from_message(const v1::ListRegistrationJobsRequest& request) {
  JobFilter filter;
  filter.state = from_message(request.state());
  filter.labels.insert(request.labels().begin(), request.labels().end());
  filter.submitter = request.submitter();
  return filter;
}

std::string conditions_of(const v1::ListRegistrationJobsRequest& request) {
  v1::ListRegistrationJobsRequest conditions = request;
  conditions.clear_page_size();
  conditions.clear_page_token();
  return stable_bytes(conditions);
}

Outcome from_message(const v1::CompleteJobRequest& request) {
  switch (request.outcome_case()) {
    case v1::CompleteJobRequest::kSuccess: {
      Delivered delivered;
      for (const auto& artifact : request.success().artifacts())
        delivered.artifacts.push_back({artifact.name(), artifact.digest(), artifact.size()});
      return delivered;
    }
    case v1::CompleteJobRequest::kFailure:
      return JobFailure{request.failure().reason(), request.failure().message()};
    case v1::CompleteJobRequest::kCancelled:
      return Stopped{};
    case v1::CompleteJobRequest::OUTCOME_NOT_SET:
      break;
  }
  throw InvalidInput("outcome is not set; it must be success, failure or cancelled");
}

Checkpoint from_message(const v1::Checkpoint& message) {
  Checkpoint checkpoint;
  checkpoint.digest = message.digest();
  checkpoint.size = message.size();
  checkpoint.level = message.level();
  checkpoint.iteration = message.iteration();
  return checkpoint;
}

v1::AcquireLeaseResponse to_message(const LeaseGrant& grant) {
  v1::AcquireLeaseResponse message;
  *message.mutable_spec() = parse_spec(grant.spec);
  message.set_threads(grant.threads);
  message.set_lease_seconds(seconds(grant.lease));
  message.set_heartbeat_interval_seconds(seconds(grant.heartbeat_interval));
  message.set_checkpoint_interval_seconds(seconds(grant.checkpoint_interval));
  message.mutable_limits()->set_memory_bytes(grant.limits.memory_bytes);
  message.mutable_limits()->set_cpu_seconds(static_cast<double>(grant.limits.cpu_seconds));
  if (!grant.checkpoint) return message;
  message.mutable_checkpoint()->set_digest(grant.checkpoint->digest);
  message.mutable_checkpoint()->set_size(grant.checkpoint->size);
  message.mutable_checkpoint()->set_level(grant.checkpoint->level);
  message.mutable_checkpoint()->set_iteration(grant.checkpoint->iteration);
  return message;
}

}  // namespace saltus::server
