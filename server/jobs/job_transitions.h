#pragma once

#include "server/jobs/job.h"

#include <optional>

namespace saltus::server {

/// What can happen to a job.
enum class JobEvent {
  Start,      ///< an attempt was handed to a launcher
  Succeed,    ///< the worker delivered its artefacts
  Fail,       ///< the worker says that the job cannot be done
  Cancel,     ///< a client does not want it any more
  Stop,       ///< the worker has stopped because it was told to
  Lose,       ///< the worker is gone without an outcome and another attempt is allowed
  GiveUp,     ///< the worker is gone without an outcome and no other attempt is allowed
  LoseInput,  ///< the bytes of an input are gone from the disk
  Release,    ///< the daemon stopped the worker to shut down
};

/// The state after `event`, or nothing when the event cannot happen in `state`.
/// A cancel of a terminal job is allowed and changes nothing; no other event touches a terminal state.
std::optional<JobState> next_state(JobState state, JobEvent event);

}  // namespace saltus::server
