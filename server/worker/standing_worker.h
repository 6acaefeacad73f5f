#pragma once

#include "server/worker/connection.h"

#include <chrono>
#include <cstdint>
#include <stop_token>
#include <string>

namespace saltus::worker {

/// What a worker that comes by itself offers, and for how long.
struct StandingOptions {
  Connection connection;
  std::string blobs;                  ///< the daemon's folder of blobs, when this machine sees it
  int threads = 1;                    ///< for one job; takes none that declares more
  std::int64_t memory_bytes = 0;      ///< the same
  std::chrono::milliseconds idle{0};  ///< ends after so long without a job or a daemon; 0: never
  std::string name;                   ///< for people
};

/// Asks the daemon for jobs, one after the other, and does each in a process of its own. A daemon that is away is
/// waited for. Returns the exit code when `stop` is requested (a job that runs is asked to end, and is queued again),
/// when it was idle for too long, when the daemon does not want this worker, or when several attempts in a row have
/// ended without an outcome: a machine that spoils every job must not go on taking them.
int stand_by(const StandingOptions& options, const std::stop_token& stop);

}  // namespace saltus::worker
