#pragma once

#include "server/jobs/job.h"

#include <functional>
#include <string>

namespace saltus::server {

struct LaunchRequest {
  AttemptKey key;
  std::string token;
  int threads = 1;
  JobLimits limits = {};  ///< of this attempt; the wall time is watched by the job manager
};

/// How a worker's process ended.
struct WorkerExit {
  enum class Kind {
    Exited,     ///< `number` is the exit code
    Signalled,  ///< `number` is the signal
    Vanished,   ///< gone; nobody could see how
  };
  Kind kind = Kind::Exited;
  int number = 0;
};

/// Exit codes of a worker that mean something to the daemon.
constexpr int kOutOfMemoryExit = 6;  ///< it had no memory left, not even for telling so
constexpr int kNoRoomExit = 7;       ///< its results found no room, on the daemon's disk or among its temporary files

/// Starts and ends worker processes. Thread-safe.
class Launcher {
 public:
  using ExitHandler = std::function<void(const AttemptKey&, const WorkerExit&)>;

  virtual ~Launcher() = default;
  /// To be called once, before anything else. The handler is called once for each process that was started or adopted,
  /// on a thread of the launcher, and must not block.
  virtual void on_exit(ExitHandler handler) = 0;
  /// Starts a worker and returns a name by which it can be adopted after a restart. Throws std::runtime_error.
  virtual std::string start(const LaunchRequest& request) = 0;
  /// Takes over a process that an earlier daemon started. False when it is gone.
  virtual bool adopt(const AttemptKey& key, const std::string& process) = 0;
  /// Asks the worker and its children to end. Nothing happens when it is gone or unknown.
  virtual void terminate(const AttemptKey& key) = 0;
  /// Ends the worker and its children by force.
  virtual void kill(const AttemptKey& key) = 0;
  /// No process is left, and the handler has been called for all.
  virtual bool is_idle() const = 0;
};

}  // namespace saltus::server
