#pragma once

#include "server/worker/lease.h"

namespace saltus::worker {

/// How saltus-worker ends; the daemon decides by the job's record, these are for people and launchers, but for
/// OutOfMemoryExit and NoRoomExit (server/jobs/launcher.h).
enum WorkerExit {
  OutcomeReported = 0,    ///< success, failure or cancellation was accepted by the daemon
  InternalError = 1,      ///< nothing was reported; the reason is on standard error
  UsageError = 2,         ///< of the command line
  DaemonUnreachable = 3,  ///< for as long as the lease lasts
  LeaseLostExit = 4,      ///< the attempt is no longer wanted
  TerminatedExit = 5,     ///< by SIGTERM, before an outcome
  OutOfMemoryExit = 6,    ///< and the daemon could not be told; it takes the code for MEMORY_LIMIT
  NoRoomExit = 7          ///< no room for the results on the daemon's disk, for as long as they could wait, or here
};

/// Does one attempt from lease to outcome: fetches the inputs into a temporary folder, runs the registration, sends the
/// artefacts and completes the job. Everything it needs from the daemon it asks for; nothing of it stays on disk.
WorkerExit run_attempt(const AttemptIdentity& identity);

}  // namespace saltus::worker
