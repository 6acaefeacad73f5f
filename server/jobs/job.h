#pragma once

#include "server/jobs/clock.h"

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace saltus::server {

enum class JobState { Queued, Running, Cancelling, Succeeded, Failed, Cancelled };

bool is_terminal(JobState state);
/// A worker holds the job: Running or Cancelling.
bool is_held(JobState state);
std::string to_string(JobState state);

/// Why a job failed: `reason` in UPPER_SNAKE for programs, `message` one sentence for people.
struct JobFailure {
  std::string reason;
  std::string message;
  bool operator==(const JobFailure&) const = default;
};

/// A file made by a job. The name is a plain file name.
struct Artifact {
  std::string name;
  std::string digest;  ///< sha256:<hex>
  std::int64_t size = 0;
  bool operator==(const Artifact&) const = default;
};

/// How soon a job is started, compared with others: 0 later, 1 as usual, 2 before others.
constexpr int kLowestPriority = 0;
constexpr int kDefaultPriority = 1;
constexpr int kHighestPriority = 2;

/// Who a job belongs to when its client is not told apart from others on this machine.
constexpr const char* kLocalSubmitter = "local";

/// What one attempt may use at most. 0: no limit.
struct JobLimits {
  std::int64_t wall_seconds = 0;  ///< from the start of the attempt: time in the queue does not count
  std::int64_t cpu_seconds = 0;
  std::int64_t memory_bytes = 0;
  bool operator==(const JobLimits&) const = default;
};

/// From where the next attempt can go on: a blob that is opaque here, and how far it is, for people.
struct Checkpoint {
  std::string digest;  ///< sha256:<hex>
  std::int64_t size = 0;
  int attempt = 0;  ///< that made it
  int level = 0;
  int iteration = 0;
  bool operator==(const Checkpoint&) const = default;
};

/// An attempt that ended without an outcome, for whoever looks for what became of it.
struct LostAttempt {
  int attempt = 0;
  std::string reason;    ///< as that of a failure
  std::string batch_id;  ///< what a batch system called it; "" when none had it
  std::string host;      ///< where the batch system ran it; "" while it waited
  WallTime ended{};
  bool operator==(const LostAttempt&) const = default;
};

/// So many are kept of one job; of more, the newest.
constexpr std::size_t kMostLostAttempts = 16;

/// Everything that is kept about a job. The specification is opaque here.
struct JobRecord {
  std::int64_t sequence = 0;  ///< order of creation, given by the store
  std::int64_t revision = 0;  ///< grows with every change
  std::string id;
  std::string submitter = kLocalSubmitter;
  std::string request_id;    ///< "" when the client gave none; unique for each submitter
  std::string request_hash;  ///< fingerprint of what was asked for
  std::string spec;
  std::vector<std::string> inputs;  ///< digests that the specification names
  std::map<std::string, std::string> labels;
  int threads = 0;  ///< 0: the daemon's default
  int priority = kDefaultPriority;
  std::int64_t memory_bytes = 0;  ///< what the job is expected to need; 0: the daemon's default
  JobLimits limits = {};

  JobState state = JobState::Queued;
  int attempt = 0;        ///< number of the current or last attempt, 0 before the first; so many there were in all
  int lost_attempts = 0;  ///< attempts that ended without an outcome and count against the limit
  int crashes = 0;        ///< of those, how many died by a signal
  std::optional<WallTime> not_before;   ///< Queued only: earliest start of the next attempt
  std::optional<JobFailure> last_loss;  ///< why the last attempt that had no outcome ended
  std::vector<LostAttempt> losses;      ///< oldest first
  std::optional<Checkpoint> checkpoint;
  std::string token_hash;         ///< fingerprint of the attempt's token
  std::string process;            ///< the launcher's name for the attempt's process; "" while unknown
  std::string batch_id;           ///< what a batch system calls the current or last attempt; "" when none had it
  std::string batch_host;         ///< where the batch system runs it; "" while it waits
  std::optional<WallTime> begun;  ///< when the worker came out of a batch system's queue; nothing while it waits

  WallTime created{};
  std::optional<WallTime> started;  ///< of the current or last attempt
  std::optional<WallTime> ended;
  std::optional<JobFailure> failure;  ///< Failed only
  std::vector<Artifact> artifacts;    ///< Succeeded only
};

/// What a client asks for.
struct NewJob {
  std::string submitter = kLocalSubmitter;
  std::string request_id;
  std::string request_hash;
  std::string spec;
  std::vector<std::string> inputs;
  std::map<std::string, std::string> labels;
  int threads = 0;
  int priority = kDefaultPriority;
  std::int64_t memory_bytes = 0;  ///< 0: the daemon's default
  JobLimits limits = {};
  bool has_quota = true;  ///< the limit of one submitter holds for it
};

enum class JobStage { Unknown, Waiting, Fetching, Validating, Optimising, Writing };

/// Where the running attempt stands; kept in memory only.
struct JobProgress {
  JobStage stage = JobStage::Unknown;
  int level = 0;
  int levels = 0;
  int iteration = 0;
  int max_iterations = 0;
  double energy = 0;
  double similarity = 0;
  double fraction = 0;
  double seconds_left = -1;  ///< -1 while unknown
  int checkpoints = 0;       ///< that this attempt has put in safety
  bool is_resumed = false;   ///< from a checkpoint of an earlier attempt
  std::int64_t memory_bytes = 0;
  double cpu_seconds = 0;        ///< of all threads together, in this attempt
  std::string waiting_for = {};  ///< Waiting only: why it does, in the batch system's words; "" while unknown
  bool operator==(const JobProgress&) const = default;
};

/// One attempt at one job.
struct AttemptKey {
  std::string job_id;
  int attempt = 0;
  auto operator<=>(const AttemptKey&) const = default;
};

}  // namespace saltus::server
