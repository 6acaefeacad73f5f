#pragma once

#include "server/jobs/job.h"

#include <functional>
#include <string>

namespace saltus::server {

struct LaunchRequest {
  AttemptKey key;
  std::string token;
  int threads = 1;
  JobLimits limits = {};          ///< of this attempt; the wall time is watched by the job manager
  std::int64_t memory_bytes = 0;  ///< what the job says it needs; 0: it does not say
};

/// How a worker's process ended.
struct WorkerExit {
  enum class Kind {
    Exited,     ///< `number` is the exit code
    Signalled,  ///< `number` is the signal; `detail` says why it was sent, when that is known
    Vanished,   ///< gone; nobody could see how
    // What a batch system does to its jobs:
    TimeLimit,    ///< ended at the time that the batch system gives it
    Preempted,    ///< ended for the sake of others
    NodeFailed,   ///< gone with its machine
    Withdrawn,    ///< taken out of the batch system by somebody else
    Refused,      ///< never accepted; `detail` says why
    NeverStarts,  ///< it can never have what the job asks for; `detail` has its word for it
  };
  Kind kind = Kind::Exited;
  int number = 0;
  std::string detail = {};
};

/// What a launcher with a queue of its own has learned of a worker.
struct QueueNews {
  std::string batch_id;          ///< what the batch system calls it
  bool has_its_turn = false;     ///< it is out of the queue, and its process is about to begin
  std::string host = {};         ///< where it runs; "" while unknown
  std::string waiting_for = {};  ///< why it is in the queue, in the batch system's words; "" while unknown
  bool operator==(const QueueNews&) const = default;
};

/// Exit codes of a worker that mean something to the daemon.
constexpr int kOutOfMemoryExit = 6;  ///< it had no memory left, not even for telling so
constexpr int kNoRoomExit = 7;       ///< its results found no room, on the daemon's disk or among its temporary files

/// Starts and ends worker processes. Thread-safe.
class Launcher {
 public:
  using ExitHandler = std::function<void(const AttemptKey&, const WorkerExit&)>;
  using NewsHandler = std::function<void(const AttemptKey&, const QueueNews&)>;

  virtual ~Launcher() = default;

  /// Its workers wait for their turn in the queue of a batch system, and are left alone when the daemon stops: they run
  /// on other machines, and the next daemon adopts them.
  virtual bool is_batch_system() const { return false; }
  /// The name by which the worker of this attempt can be adopted, when it is known before start(); else "".
  virtual std::string name_of(const AttemptKey&) const { return ""; }
  /// To be called once, before on_exit(). Called like the other handler, and before it, whenever there is something
  /// new.
  virtual void on_news(NewsHandler) {}

  /// To be called once, before anything else. The handler is called once for each process that was started or adopted,
  /// on a thread of the launcher, and must not block.
  virtual void on_exit(ExitHandler handler) = 0;
  /// Starts a worker and returns a name by which it can be adopted after a restart. Throws std::runtime_error. Does not
  /// wait for a batch system: one that is away for a while takes the worker later.
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
