#include "server/jobs/job_manager.h"

#include "server/jobs/refusal.h"

#include <algorithm>
#include <future>
#include <limits>
#include <memory>

namespace saltus::server {
namespace {

// How many finished jobs tell how long the next ones take.
constexpr int kRememberedDurations = 32;
constexpr auto kNewest = std::numeric_limits<std::int64_t>::max();
constexpr auto kAll = std::numeric_limits<int>::max();

// No retry waits longer than so many first delays, whatever the wall clock says: 4 ^ 3.
constexpr int kLongestRetry = 64;
// SIGXCPU: the kernel ends a process that has used up the limit it was given.
constexpr int kProcessorTimeSignal = 24;
// How long a daemon takes that goes down and comes back.
constexpr std::chrono::milliseconds kRestart{5000};

Demand total_of(const ManagerSettings& settings) {
  Demand total;
  total.threads = settings.thread_budget > 0 ? settings.thread_budget : std::numeric_limits<int>::max();
  total.memory_bytes = settings.memory_budget > 0 ? settings.memory_budget : std::numeric_limits<std::int64_t>::max();
  return total;
}

std::string gibibytes(std::int64_t bytes) {
  const std::int64_t tenths = (bytes * 10 + (1 << 30) - 1) >> 30;
  return std::to_string(tenths / 10) + "." + std::to_string(tenths % 10) + " GiB";
}

JobFailure failure_of(Limit limit, const JobLimits& limits) {
  switch (limit) {
    case Limit::WallTime:
      return {"WALL_TIME", "the attempt has taken the " + std::to_string(limits.wall_seconds) +
                               " s that the job allows it; allow more, or choose a faster preset"};
    case Limit::CpuTime:
      return {"CPU_TIME", "the attempt has used the " + std::to_string(limits.cpu_seconds) +
                              " s of processor time that the job allows it; allow more, or choose a faster preset"};
    case Limit::Memory:
      return {"MEMORY_LIMIT", "the worker uses more than the " + gibibytes(limits.memory_bytes) +
                                  " that the job allows it; allow more, or crop the images"};
  }
  return {};
}

Refusal draining() {
  return {RefusalKind::Unavailable, "DRAINING", "the daemon is shutting down and takes no new jobs; try again later",
          kRestart};
}

Refusal paused() {
  return {RefusalKind::Unavailable, "DRAINING",
          "an administrator has this daemon drained, so it takes no new jobs; try again later"};
}

Refusal lease_lost(const AttemptKey& key) {
  return {RefusalKind::Aborted, "LEASE_LOST",
          "attempt " + std::to_string(key.attempt) + " of job " + key.job_id +
              " is not wanted any more; the worker must end without output"};
}

}  // namespace

namespace {

/// After `decide` has changed the job: the row of a checkpoint that it has no more goes in the same transaction.
template <class Decide>
std::optional<JobRecord> with_checkpoint_dropped(JobTable& table, const std::string& id, Decide& decide,
                                                 std::vector<std::string>& orphans) {
  const auto before = table.find(id);
  auto after = decide(table);
  if (!before || !before->checkpoint || !after) return after;
  const std::string& digest = before->checkpoint->digest;
  const bool is_kept = after->checkpoint && after->checkpoint->digest == digest;
  if (!is_kept && table.erase_blob_if_unreferenced(digest)) orphans.push_back(digest);
  return after;
}

}  // namespace

/// What one transaction has done.
struct JobManager::Change {
  std::optional<JobRecord> job;
  std::vector<std::string> orphans;  ///< digests of blobs that have lost their row
};

JobManager::JobManager(JobStore& store, BlobCatalog& blobs, Launcher& launcher, const Clock& clock, IdSource& ids,
                       ManagerSettings settings, std::function<void()> wake,
                       std::function<void(const std::string&)> log)
    : store_(store),
      blobs_(blobs),
      launcher_(launcher),
      clock_(clock),
      ids_(ids),
      settings_(settings),
      wake_(std::move(wake)),
      log_(std::move(log)),
      queue_(clock, ids, settings.queue),
      waiting_(settings.fairness),
      budget_(settings.slots, total_of(settings)),
      leases_(settings.lease, settings.cancel_ladder, settings.stall_timeout) {
  launcher_.on_exit([this](const AttemptKey& key, const WorkerExit& exit) { worker_ended(key, exit); });
}

void JobManager::write_change(const std::string& id, std::function<std::optional<JobRecord>(JobTable&)> decide,
                              std::function<void(std::exception_ptr, const Change&)> done) {
  auto change = std::make_shared<Change>();
  store_.write([change, id, decide = std::move(decide)](
                   JobTable& table) { change->job = with_checkpoint_dropped(table, id, decide, change->orphans); },
               [this, change, done = std::move(done)](std::exception_ptr error) {
                 if (!error) {
                   if (change->job) committed(*change->job);
                   if (!change->orphans.empty()) blobs_.drop_bytes(change->orphans);
                 }
                 done(error, *change);
               });
}

void JobManager::committed(const JobRecord& job) {
  {
    std::lock_guard lock(mutex_);
    const AttemptKey key{job.id, job.attempt};
    job.state == JobState::Queued ? waiting_.put(waiting(job)) : waiting_.remove(job.id);
    queued_ = waiting_.size();
    if (!is_held(job.state)) {
      leases_.end(key);
      const bool has_run = running_.erase(key) > 0;
      if (has_run && job.state == JobState::Succeeded) durations_.add(*job.ended - *job.started);
      progress_.erase(job.id);
      budget_.ended(key, by_force_.contains(key));
      if (job.attempt > 0) retired_.try_emplace(key, clock_.steady() + settings_.linger);
    } else if (job.state == JobState::Cancelling) {
      leases_.cancel(job.id, clock_.steady());
    }
  }
  watchers_.changed(job);
  wake_();
}

void JobManager::recover() {
  std::vector<JobRecord> held, queued, finished;
  store_.read([&](JobReader& reader) {
    queued = reader.queued();
    finished = reader.list({.state = JobState::Succeeded}, kNewest, kRememberedDurations);
    for (const JobState state : {JobState::Running, JobState::Cancelling})
      for (JobRecord& job : reader.list({.state = state}, kNewest, kAll)) held.push_back(std::move(job));
  });
  {
    std::lock_guard lock(mutex_);
    for (const JobRecord& job : queued) waiting_.put(waiting(job));
    queued_ = waiting_.size();
    for (const JobRecord& job : finished)
      if (job.started && job.ended) durations_.add(*job.ended - *job.started);
  }
  for (const JobRecord& job : held) {
    const AttemptKey key{job.id, job.attempt};
    const bool is_gone = !job.process.empty() && !launcher_.adopt(key, job.process);
    if (is_gone) {
      std::promise<void> is_durable;
      write_change(
          key.job_id, [&](JobTable& table) { return queue_.lose(table, key, LossCause::Vanished, ""); },
          [&](std::exception_ptr error, const Change&) {
            error ? is_durable.set_exception(error) : is_durable.set_value();
          });
      is_durable.get_future().get();
      continue;
    }
    std::lock_guard lock(mutex_);
    const WallTime began = job.started.value_or(clock_.wall());
    leases_.grant(key, job.token_hash, clock_.steady(), job.limits,
                  std::max(clock_.wall() - began, std::chrono::milliseconds(0)));
    running_[key] = began;
    budget_.take(key, demand_of(job.threads, job.memory_bytes));
    if (!job.process.empty()) budget_.has_process(key);
    if (job.state == JobState::Cancelling) leases_.cancel(job.id, clock_.steady());
  }
}

void JobManager::require_room(const NewJob& job) const {
  const Demand demand = demand_of(job.threads, job.memory_bytes);
  if (!budget_.is_too_large(demand)) return;
  const Demand& total = budget_.total();
  throw Refusal(RefusalKind::FailedPrecondition, "EXCEEDS_BUDGET",
                demand.threads > total.threads
                    ? "the job asks for " + std::to_string(demand.threads) + " threads, this daemon has " +
                          std::to_string(total.threads) + " for all its workers; ask for fewer threads"
                    : "the job needs " + gibibytes(demand.memory_bytes) + " of memory, this daemon has " +
                          gibibytes(total.memory_bytes) +
                          " for all its workers; crop the images, or use a machine with more memory");
}

void JobManager::submit(const NewJob& job, Reply<JobView> reply) {
  if (is_draining_) throw draining();
  if (is_paused_) throw paused();
  require_room(job);
  write_change(
      "", [this, job](JobTable& table) { return queue_.submit(table, job); },
      [this, reply = std::move(reply)](std::exception_ptr error, const Change& change) {
        reply(error, error ? JobView{} : view(*change.job));
      });
}

void JobManager::submit_all(const std::vector<NewJob>& jobs, Reply<std::vector<JobView>> reply) {
  if (is_draining_) throw draining();
  if (is_paused_) throw paused();
  for (const NewJob& job : jobs) require_room(job);
  auto made = std::make_shared<std::vector<JobRecord>>();
  store_.write(
      [this, jobs, made](JobTable& table) {
        for (const NewJob& job : jobs) made->push_back(queue_.submit(table, job));
      },
      [this, made, reply = std::move(reply)](std::exception_ptr error) {
        if (error) return reply(error, {});
        for (const JobRecord& job : *made) committed(job);
        std::vector<JobView> views;
        for (const JobRecord& job : *made) views.push_back(view(job));
        reply(nullptr, views);
      });
}

void JobManager::cancel(const std::string& id, Reply<JobView> reply) {
  write_change(
      id, [this, id](JobTable& table) { return queue_.cancel(table, id); },
      [this, reply = std::move(reply)](std::exception_ptr error, const Change& change) {
        reply(error, error ? JobView{} : view(*change.job));
      });
}

void JobManager::remove(const std::string& id, Reply<std::string> reply) {
  auto orphans = std::make_shared<std::vector<std::string>>();
  write_change(
      id,
      [this, id, orphans](JobTable& table) -> std::optional<JobRecord> {
        for (const std::string& digest : queue_.remove(table, id))
          if (table.erase_blob_if_unreferenced(digest)) orphans->push_back(digest);
        return std::nullopt;
      },
      [this, id, orphans, reply = std::move(reply)](std::exception_ptr error, const Change&) {
        if (!error) {
          {
            std::lock_guard lock(mutex_);
            waiting_.remove(id);
            queued_ = waiting_.size();
          }
          watchers_.deleted(id);
          blobs_.drop_bytes(*orphans);
        }
        reply(error, id);
      });
}

JobView JobManager::get(const std::string& id) {
  JobRecord job;
  store_.read([&](JobReader& reader) { job = require_job(reader, id); });
  return view(job);
}

std::vector<JobView> JobManager::list(const JobFilter& filter, std::int64_t before, int limit) {
  std::vector<JobRecord> jobs;
  store_.read([&](JobReader& reader) { jobs = reader.list(filter, before, limit); });
  std::vector<JobView> views;
  for (const JobRecord& job : jobs) views.push_back(view(job));
  return views;
}

JobView JobManager::view(const JobRecord& job) {
  JobView view;
  view.job = job;
  std::lock_guard lock(mutex_);
  if (is_held(job.state))
    if (const auto found = progress_.find(job.id); found != progress_.end()) view.progress = found->second;
  if (job.state != JobState::Queued) return view;
  const WallTime now = clock_.wall();
  view.queue_position = waiting_.position(job.id, now);
  const auto typical = durations_.typical();
  if (!typical || view.queue_position == 0) return view;
  std::vector<WallTime> running;
  for (const auto& [key, began] : running_) running.push_back(began);
  const WallTime start = estimate_start(view.queue_position, std::move(running), settings_.slots, *typical, now);
  view.estimated_start = std::max(start, job.not_before.value_or(start));
  return view;
}

LeaseGrant JobManager::acquire(const AttemptKey& key, const std::string& token) {
  {
    std::lock_guard lock(mutex_);
    const auto wanted = leases_.renew(key, ids_.fingerprint(token), clock_.steady());
    if (wanted != LeaseTable::Wanted::Continue) throw lease_lost(key);
  }
  JobRecord job;
  store_.read([&](JobReader& reader) { job = require_job(reader, key.job_id); });
  return {job.spec,
          threads_of(job),
          settings_.lease,
          settings_.heartbeat_interval,
          job.limits,
          job.checkpoint,
          settings_.checkpoint_interval};
}

void JobManager::put_checkpoint(const AttemptKey& key, const std::string& token, const Checkpoint& checkpoint,
                                Reply<JobRecord> reply) {
  // No state changes, so nobody is told.
  auto kept = std::make_shared<Change>();
  store_.write(
      [this, key, token, checkpoint, kept](JobTable& table) {
        const auto put = [&](JobTable& rows) -> std::optional<JobRecord> {
          return queue_.put_checkpoint(rows, key, token, checkpoint);
        };
        kept->job = with_checkpoint_dropped(table, key.job_id, put, kept->orphans);
      },
      [this, kept, reply = std::move(reply)](std::exception_ptr error) {
        if (!error && !kept->orphans.empty()) blobs_.drop_bytes(kept->orphans);
        reply(error, error ? JobRecord{} : *kept->job);
      });
}

LeaseTable::Wanted JobManager::heartbeat(const AttemptKey& key, const std::string& token, const JobProgress& progress) {
  std::optional<LeaseTable::Wanted> wanted;
  {
    std::lock_guard lock(mutex_);
    wanted = leases_.renew(key, ids_.fingerprint(token), clock_.steady());
    if (!wanted) throw lease_lost(key);
    progress_[key.job_id] = progress;
    leases_.progressed(key, progress, clock_.steady());
  }
  watchers_.progressed(key.job_id, progress);
  return *wanted;
}

void JobManager::complete(const AttemptKey& key, const std::string& token, const Outcome& outcome,
                          Reply<JobRecord> reply) {
  write_change(
      key.job_id,
      [this, key, token, outcome](JobTable& table) {
        return queue_.complete(table, key, token, outcome, is_draining_ ? LossCause::Released : LossCause::Stopped);
      },
      [reply = std::move(reply)](std::exception_ptr error, const Change& change) {
        reply(error, error ? JobRecord{} : *change.job);
      });
}

void JobManager::end_attempt(const AttemptKey& key, std::function<std::optional<JobRecord>(JobTable&)> decide,
                             const std::string& detail, Ending ending) {
  if (ending != Ending::None) {
    std::lock_guard lock(mutex_);
    by_force_.insert(key);
  }
  write_change(key.job_id, std::move(decide), [=, this](std::exception_ptr error, const Change& change) {
    {
      std::lock_guard lock(mutex_);
      by_force_.erase(key);
      if (error) {
        // Not recorded: the lease stays, so that its end comes due once more.
        leases_.retry_end(key, clock_.steady());
        return;
      }
      if (!change.job) {
        // The attempt had ended before: nothing was lost, and its lease must not hold a slot.
        leases_.end(key);
        running_.erase(key);
        budget_.ended(key, ending != Ending::None);
      }
    }
    // Only now: the death of the process must not count as a crash.
    if (ending == Ending::Terminate) launcher_.terminate(key);
    if (ending == Ending::Kill) launcher_.kill(key);
    if (change.job && !detail.empty())
      log_("job " + key.job_id + ", attempt " + std::to_string(key.attempt) + ": " + detail);
  });
}

void JobManager::lose(const AttemptKey& key, LossCause cause, const std::string& detail, Ending ending) {
  const bool is_quiet = cause == LossCause::Exited && detail == "exit code 0";
  end_attempt(
      key, [this, key, cause, detail](JobTable& table) { return queue_.lose(table, key, cause, detail); },
      is_quiet ? "" : describe(cause, detail), ending);
}

void JobManager::fail(const AttemptKey& key, Limit limit, Ending ending) {
  end_attempt(
      key,
      [this, key, limit](JobTable& table) -> std::optional<JobRecord> {
        const auto job = table.find(key.job_id);
        if (!job) return std::nullopt;
        // A limit that the job did not ask for was set by somebody else.
        if (limit == Limit::CpuTime && job->limits.cpu_seconds == 0)
          return queue_.lose(table, key, LossCause::Crashed, "signal " + std::to_string(kProcessorTimeSignal));
        return queue_.fail(table, key, failure_of(limit, job->limits));
      },
      "", ending);
}

void JobManager::worker_ended(const AttemptKey& key, const WorkerExit& exit) {
  {
    std::lock_guard lock(mutex_);
    retired_.erase(key);
    budget_.exited(key);
  }
  wake_();
  const std::string number = std::to_string(exit.number);
  if (is_draining_) return lose(key, LossCause::Released, "");
  switch (exit.kind) {
    case WorkerExit::Kind::Exited:
      return lose(key, LossCause::Exited, "exit code " + number);
    case WorkerExit::Kind::Signalled:
      if (exit.number == kProcessorTimeSignal) return fail(key, Limit::CpuTime, Ending::None);
      return lose(key, LossCause::Crashed, "signal " + number);
    case WorkerExit::Kind::Vanished:
      return lose(key, LossCause::Vanished, "");
  }
}

void JobManager::tick() {
  const SteadyTime now = clock_.steady();
  LeaseTable::Due due;
  std::deque<LaunchRequest> launches;
  {
    std::lock_guard lock(mutex_);
    due = leases_.due(now);
    launches.swap(launches_);
    for (auto it = retired_.begin(); it != retired_.end();) {
      if (now < it->second) {
        ++it;
        continue;
      }
      due.kill.push_back(it->first);
      it = retired_.erase(it);
    }
    if (drain_started_ && now >= *drain_started_ + settings_.drain_grace)
      for (const AttemptKey& key : leases_.all()) due.kill.push_back(key);
  }
  // A process that does not heed the request to end is killed after `linger`, as every one that outlives its attempt.
  for (const AttemptKey& key : due.expired) lose(key, LossCause::LeaseExpired, "", Ending::Kill);
  const auto stall = std::chrono::round<std::chrono::seconds>(settings_.stall_timeout).count();
  for (const AttemptKey& key : due.stalled)
    lose(key, LossCause::Stalled, std::to_string(stall) + " s", Ending::Terminate);
  for (const auto& [key, limit] : due.over_limit) fail(key, limit, Ending::Terminate);
  for (const AttemptKey& key : due.terminate) launcher_.terminate(key);
  for (const AttemptKey& key : due.kill) launcher_.kill(key);
  for (const LaunchRequest& request : launches) launch(request);
  dispatch();
}

void JobManager::launch(const LaunchRequest& request) {
  const AttemptKey key = request.key;
  {
    std::unique_lock lock(mutex_);
    const bool is_unwanted = drain_started_.has_value() || leases_.is_cancelled(key);
    lock.unlock();
    if (is_unwanted) return lose(key, LossCause::Released, "");
  }
  std::string process;
  try {
    process = launcher_.start(request);
  } catch (const std::exception& error) {
    return lose(key, LossCause::LaunchFailed, error.what());
  }
  {
    std::lock_guard lock(mutex_);
    budget_.has_process(key);
  }
  store_.write(
      [key, process](JobTable& table) {
        auto job = table.find(key.job_id);
        if (!job || job->attempt != key.attempt || !is_held(job->state)) return;
        job->process = process;
        table.update(*job);
      },
      // When this is not kept, a restarted daemon finds the worker by its heartbeats instead.
      [](std::exception_ptr) {});
}

void JobManager::dispatch() {
  std::optional<WaitingJob> next;
  {
    std::lock_guard lock(mutex_);
    if (is_dispatching_ || drain_started_ || is_paused_ || queued_ == 0 || !budget_.fits({0, 0})) return;
    next = waiting_.next(clock_.wall(), clock_.steady(), [this](const Demand& demand) { return budget_.fits(demand); });
    if (!next) return;
    is_dispatching_ = true;
  }
  auto taken = std::make_shared<std::optional<JobQueue::Taken>>();
  store_.write([this, id = next->id, taken](JobTable& table) { *taken = queue_.start(table, id); },
               [this, next = *next, taken](std::exception_ptr error) {
                 {
                   std::lock_guard lock(mutex_);
                   is_dispatching_ = false;
                   if (error) return;
                   if (!*taken) return waiting_.remove(next.id);
                   const JobRecord& job = (*taken)->job;
                   const AttemptKey key{job.id, job.attempt};
                   waiting_.started(job.id);
                   leases_.grant(key, job.token_hash, clock_.steady(), job.limits);
                   running_[key] = *job.started;
                   budget_.take(key, next.demand);
                   launches_.push_back({key, (*taken)->token, next.demand.threads, job.limits});
                 }
                 committed((*taken)->job);
               });
}

void JobManager::begin_drain() {
  std::vector<AttemptKey> keys;
  {
    std::lock_guard lock(mutex_);
    if (drain_started_) return;
    drain_started_ = clock_.steady();
    is_draining_ = true;
    keys = leases_.all();
  }
  for (const AttemptKey& key : keys) launcher_.terminate(key);
  wake_();
}

void JobManager::set_paused(bool is_paused) {
  is_paused_ = is_paused;
  wake_();
}

bool JobManager::is_drained() const {
  std::lock_guard lock(mutex_);
  return is_draining_ && launches_.empty() && !is_dispatching_ && launcher_.is_idle();
}

int JobManager::running_jobs() const {
  std::lock_guard lock(mutex_);
  return leases_.size();
}

int JobManager::threads_of(const JobRecord& job) const {
  return job.threads > 0 ? job.threads : settings_.default_threads;
}

Demand JobManager::demand_of(int threads, std::int64_t memory_bytes) const {
  const std::int64_t share =
      settings_.default_memory > 0 ? settings_.default_memory : settings_.memory_budget / settings_.slots;
  return {threads > 0 ? threads : settings_.default_threads, memory_bytes > 0 ? memory_bytes : share};
}

WaitingJob JobManager::waiting(const JobRecord& job) const {
  WaitingJob waiting;
  waiting.id = job.id;
  waiting.submitter = job.submitter;
  waiting.sequence = job.sequence;
  waiting.priority = job.priority;
  waiting.demand = demand_of(job.threads, job.memory_bytes);
  waiting.created = job.created;
  // On the clock that never jumps: setting the machine's time must not hold a retry back.
  waiting.ready = clock_.steady();
  if (job.not_before)
    waiting.ready += std::clamp(*job.not_before - clock_.wall(), std::chrono::milliseconds(0),
                                settings_.queue.retry_delay * kLongestRetry);
  return waiting;
}

}  // namespace saltus::server
