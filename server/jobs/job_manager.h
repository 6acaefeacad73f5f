#pragma once

#include "server/jobs/blob_catalog.h"
#include "server/jobs/budget.h"
#include "server/jobs/job_queue.h"
#include "server/jobs/launcher.h"
#include "server/jobs/lease_table.h"
#include "server/jobs/start_estimate.h"
#include "server/jobs/waiting_list.h"
#include "server/jobs/watch_hub.h"

#include <atomic>
#include <chrono>
#include <deque>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace saltus::server {

struct ManagerSettings {
  int slots = 1;            ///< workers at the same time
  int default_threads = 1;  ///< of a worker whose job does not say
  /// What all workers together may use. 0: not counted.
  int thread_budget = 0;
  std::int64_t memory_budget = 0;  ///< bytes
  /// Of a job that does not say. 0: an equal share of the budget for each slot.
  std::int64_t default_memory = 0;
  FairnessRules fairness;
  std::chrono::milliseconds stall_timeout{std::chrono::minutes(15)};
  std::chrono::milliseconds lease{30000};
  std::chrono::milliseconds heartbeat_interval{1000};
  std::chrono::milliseconds checkpoint_interval{30000};  ///< at least, between two of one attempt; 0: none are made
  /// How long a worker that a batch system has let begin may take until its first call.
  std::chrono::milliseconds first_call{120000};
  CancelLadder cancel_ladder;
  std::chrono::milliseconds linger{5000};       ///< for a worker's process to end after its attempt has ended
  std::chrono::milliseconds drain_grace{2000};  ///< for workers to end when the daemon shuts down
  QueueLimits queue;
};

struct JobView {
  JobRecord job;
  std::optional<JobProgress> progress;      ///< of a running attempt that has reported
  int queue_position = 0;                   ///< 1 is next; 0 when not queued
  std::optional<WallTime> estimated_start;  ///< of a queued job; nothing while no job has told how long jobs take
};

struct LeaseGrant {
  std::string spec;
  int threads = 1;
  std::chrono::milliseconds lease{};
  std::chrono::milliseconds heartbeat_interval{};
  JobLimits limits;
  std::optional<Checkpoint> checkpoint;  ///< of an earlier attempt, to go on from
  std::chrono::milliseconds checkpoint_interval{};
};

/// What a worker that comes by itself can do at a time.
struct Offer {
  int threads = 1;
  std::int64_t memory_bytes = 0;  ///< 0: any amount
  auto operator<=>(const Offer&) const = default;
};

/// An attempt that was given to such a worker.
struct TakenJob {
  AttemptKey key;
  std::string token;
  int threads = 1;
};

/// `error` is nothing when the call succeeded; else the second argument means nothing.
template <class T>
using Reply = std::function<void(std::exception_ptr error, const T& value)>;

/// Acts on what JobQueue decides: keeps it in the store, tells watchers once it is durable, starts and stops workers.
///
/// `log` gets one line for each change of a job; it may be called from several threads and must not block for long.
///
/// Life: construct, recover(), then any call from any thread; tick() from one thread, about every 50 ms and whenever
/// `wake` asks for it. It has no thread of its own. Store and launcher must stop calling back before it is destroyed.
/// Replies come from the store's writing thread and must not block. Methods without a reply that touch the store block;
/// those that never block say so.
class JobManager {
 public:
  JobManager(JobStore& store, BlobCatalog& blobs, Launcher& launcher, const Clock& clock, IdSource& ids,
             ManagerSettings settings, std::function<void()> wake, std::function<void(const std::string& line)> log);

  /// Takes over what an earlier daemon left: workers that are still there go on, jobs of the others are queued again.
  /// A worker that cannot be found gets one lease of grace to report. Blocks until all is durable.
  void recover();

  /// Throws FailedPrecondition EXCEEDS_BUDGET for a job that the daemon could never run.
  void submit(const NewJob& job, Reply<JobView> reply);
  /// All of them, or none with the refusal of the first that cannot be had.
  void submit_all(const std::vector<NewJob>& jobs, Reply<std::vector<JobView>> reply);
  void cancel(const std::string& id, Reply<JobView> reply);
  void remove(const std::string& id, Reply<std::string> reply);
  JobView get(const std::string& id);
  /// Newest first; see JobReader::list.
  std::vector<JobView> list(const JobFilter& filter, std::int64_t before, int limit);
  /// What is known beside the row. Never blocks.
  JobView view(const JobRecord& job);
  WatchHub& watchers() { return watchers_; }

  /// `worker`: what the process calls itself; only the first that comes has the attempt. "" for one without a name.
  LeaseGrant acquire(const AttemptKey& key, const std::string& token, const std::string& worker = "");
  /// Never blocks.
  LeaseTable::Wanted heartbeat(const AttemptKey& key, const std::string& token, const JobProgress& progress);
  /// See JobQueue::put_checkpoint. The bytes of the checkpoint before it are removed once this one is durable; the last
  /// one goes when the job ends.
  void put_checkpoint(const AttemptKey& key, const std::string& token, const Checkpoint& checkpoint,
                      Reply<JobRecord> reply);
  void complete(const AttemptKey& key, const std::string& token, const Outcome& outcome, Reply<JobRecord> reply);

  /// Calls `reply` once, from any thread: with the next job that fits, or with nothing when none has come within
  /// `wait`, the daemon stops, or the taker is withdrawn. Never blocks. Throws Exhausted TOO_MANY_STREAMS.
  std::uint64_t take(const Offer& offer, std::chrono::milliseconds wait,
                     std::function<void(const std::optional<TakenJob>&)> reply);
  /// It is not there any more: what it would have got goes to another.
  void withdraw(std::uint64_t taker);
  /// How the process of an attempt that was taken so has ended. Never blocks. Nothing happens when the attempt is over.
  void report_exit(const AttemptKey& key, const std::string& token, const WorkerExit& exit);

  void tick();
  /// From now on no job is accepted or started; workers are asked to end and their jobs are queued again. Those of a
  /// batch system go on.
  void begin_drain();
  /// While paused, jobs are refused as in a drain and no attempt is started; what runs goes on.
  void set_paused(bool is_paused);
  bool is_paused() const { return is_paused_; }
  bool is_draining() const { return is_draining_; }
  /// All workers that have to go are gone.
  bool is_drained() const;

  /// Never block.
  int queued_jobs() const { return queued_; }
  int running_jobs() const;
  int slots() const { return settings_.slots; }
  /// What the running attempts use together, as their last heartbeats say.
  struct Use {
    std::int64_t memory_bytes = 0;
    double cpu_seconds = 0;
  };
  Use use_of_workers() const;
  const Demand& budget() const { return budget_.total(); }
  bool counts_memory() const { return settings_.memory_budget > 0; }

 private:
  /// What one transaction has done.
  struct Change {
    std::optional<JobRecord> job;
    std::vector<std::string> orphans;  ///< digests of blobs that have lost their row
  };
  /// Changes the row of one job. A checkpoint that the job has no more is removed.
  void write_job(const std::string& id, std::function<std::optional<JobRecord>(JobTable&)> decide,
                 std::function<void(std::exception_ptr, const Change&)> done);
  /// As write_job, then tells everybody who has to know.
  void write_change(const std::string& id, std::function<std::optional<JobRecord>(JobTable&)> decide,
                    std::function<void(std::exception_ptr, const Change&)> done);
  void committed(const JobRecord& job);
  /// What is done about a process whose attempt has been ended without it.
  enum class Ending { None, Terminate, Kill };
  void end_attempt(const AttemptKey& key, std::function<std::optional<JobRecord>(JobTable&)> decide,
                   const std::string& detail, Ending ending);
  void lose(const AttemptKey& key, LossCause cause, const std::string& detail, Ending ending = Ending::None);
  void fail(const AttemptKey& key, Limit limit, Ending ending);
  void time_limit_reached(const AttemptKey& key);
  void never_starts(const AttemptKey& key, const std::string& reason);
  void require_room(const NewJob& job) const;
  void worker_ended(const AttemptKey& key, const WorkerExit& exit);
  void has_news(const AttemptKey& key, const QueueNews& news);
  /// Writes down that the worker has come out of the queue of a batch system.
  void has_begun(const AttemptKey& key);
  /// Under the lock: it does not wait any more.
  void forget_stage(const AttemptKey& key);
  struct Taker {
    Offer offer;
    SteadyTime until;
    std::function<void(const std::optional<TakenJob>&)> reply;
  };
  using Takers = std::map<std::uint64_t, Taker>;  ///< by age
  /// What is to be started next, and by whom.
  struct Pick {
    WaitingJob job;
    std::optional<Takers::value_type> taker;  ///< nothing: the launcher
    std::string process;                      ///< what the launcher will call it
    std::optional<JobQueue::Taken> taken;
    AttemptKey key() const { return {job.id, job.attempt + 1}; }
  };
  void dispatch();
  /// Under the lock, as the next three. Chooses and takes out of the list.
  std::optional<Pick> choose();
  void start(const Pick& pick);
  void put_back(Pick& pick);
  Fit fit_of(const Demand& demand, const Offer& offer) const;
  /// Those whose time is over; all of them when the daemon stops.
  std::vector<Taker> dismissed(SteadyTime now);
  void launch(const LaunchRequest& request);
  int threads_of(const JobRecord& job) const;
  Demand demand_of(int threads, std::int64_t memory_bytes) const;
  WaitingJob waiting(const JobRecord& job) const;

  JobStore& store_;
  BlobCatalog& blobs_;
  Launcher& launcher_;
  /// What the store tells of its last writes when the daemon ends must not need the launcher, which is gone by then.
  const bool is_batch_system_;
  const Clock& clock_;
  IdSource& ids_;
  const ManagerSettings settings_;
  const std::function<void()> wake_;
  const std::function<void(const std::string&)> log_;
  const JobQueue queue_;
  WatchHub watchers_;

  mutable std::mutex mutex_;
  WaitingList waiting_;
  Budget budget_;
  RecentDurations durations_;
  LeaseTable leases_;
  std::map<AttemptKey, WallTime> running_;  ///< since when
  std::set<AttemptKey> by_force_;           ///< attempts that are ended although their workers are still there
  std::map<std::string, JobProgress> progress_;
  std::deque<LaunchRequest> launches_;  ///< taken from the queue, to be started by tick()
  Takers takers_;                       ///< that wait
  std::uint64_t last_taker_ = 0;
  std::set<std::uint64_t> withdrawn_;         ///< while they were being given a job
  std::set<AttemptKey> remote_;               ///< attempts that were given to takers
  std::map<AttemptKey, SteadyTime> retired_;  ///< attempts that have ended, and when their process must be gone
  bool is_dispatching_ = false;
  std::optional<SteadyTime> drain_started_;
  std::atomic<bool> is_draining_{false};
  std::atomic<bool> is_paused_{false};
  std::atomic<int> queued_{0};
};

}  // namespace saltus::server
