#pragma once

#include "server/jobs/job.h"

#include <functional>
#include <map>
#include <optional>
#include <string>

namespace saltus::server {

/// What a job's record says that its last one did not.
struct JobStep {
  enum class Kind {
    Queued,   ///< made
    Started,  ///< an attempt has begun
    Cancelling,
    Requeued,  ///< an attempt has ended without an outcome, the job waits for the next
    Ended,
  };
  Kind kind = Kind::Queued;
  bool has_lost_attempt = false;  ///< Requeued, or Ended because of it
};

/// Tells steps from the stream of committed records, in which the same record may come twice. Keeps the jobs that have
/// not ended. One thread at a time.
class JobHistory {
 public:
  /// Jobs that have not ended, when the daemon starts.
  void seed(const JobRecord& job);
  /// Nothing when the record brings nothing new.
  std::optional<JobStep> changed(const JobRecord& job);
  void deleted(const std::string& id);
  int count(JobState state) const;

 private:
  struct Known {
    JobState state;
    int attempt;
    int lost_attempts;
  };
  std::map<std::string, Known> open_;
  std::map<JobState, int> counts_;
};

}  // namespace saltus::server
