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
// When an administrator takes a drain back, nobody knows.
constexpr std::chrono::milliseconds kDrained{30000};

Demand total_of(const ManagerSettings& settings) {
  Demand total;
  total.threads = settings.thread_budget > 0 ? settings.thread_budget : std::numeric_limits<int>::max();
  total.memory_bytes = settings.memory_budget > 0 ? settings.memory_budget : std::numeric_limits<std::int64_t>::max();
  return total;
}

Refusal draining() {
  return {RefusalKind::Unavailable, "DRAINING", "the daemon is shutting down and takes no new jobs; try again later",
          kRestart};
}

Refusal paused() {
  return {RefusalKind::Unavailable, "DRAINING",
          "an administrator has this daemon drained, so it takes no new jobs; try again later", kDrained};
}

/// When the worker of the last attempt began: what came before was a batch system's queue.
WallTime began_at(const JobRecord& job) { return job.begun.value_or(*job.started); }

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

JobManager::JobManager(JobStore& store, BlobCatalog& blobs, Launcher& launcher, const Clock& clock, IdSource& ids,
                       ManagerSettings settings, std::function<void()> wake,
                       std::function<void(const std::string&)> log)
    : store_(store),
      blobs_(blobs),
      launcher_(launcher),
      is_batch_system_(launcher.is_batch_system()),
      clock_(clock),
      ids_(ids),
      settings_(settings),
      wake_(std::move(wake)),
      log_(std::move(log)),
      queue_(clock, ids, settings.queue),
      waiting_(settings.fairness),
      budget_(settings.slots, total_of(settings)),
      leases_(settings.lease, settings.cancel_ladder, settings.stall_timeout) {
  launcher_.on_news([this](const AttemptKey& key, const QueueNews& news) { has_news(key, news); });
  launcher_.on_exit([this](const AttemptKey& key, const WorkerExit& exit) { worker_ended(key, exit); });
}

void JobManager::write_job(const std::string& id, std::function<std::optional<JobRecord>(JobTable&)> decide,
                           std::function<void(std::exception_ptr, const Change&)> done) {
  auto change = std::make_shared<Change>();
  store_.write([change, id, decide = std::move(decide)](
                   JobTable& table) { change->job = with_checkpoint_dropped(table, id, decide, change->orphans); },
               [this, change, done = std::move(done)](std::exception_ptr error) {
                 if (!error && !change->orphans.empty()) blobs_.drop_bytes(change->orphans);
                 done(error, *change);
               });
}

void JobManager::write_change(const std::string& id, std::function<std::optional<JobRecord>(JobTable&)> decide,
                              std::function<void(std::exception_ptr, const Change&)> done) {
  write_job(id, std::move(decide), [this, done = std::move(done)](std::exception_ptr error, const Change& change) {
    if (!error && change.job) committed(*change.job);
    done(error, change);
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
      if (has_run && job.state == JobState::Succeeded) durations_.add(*job.ended - began_at(job));
      progress_.erase(job.id);
      budget_.ended(key, by_force_.contains(key));
      remote_.erase(key);
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
  std::vector<LastStart> starts;
  store_.read([&](JobReader& reader) {
    queued = reader.queued();
    starts = reader.last_starts();
    finished = reader.list({.state = JobState::Succeeded}, kNewest, kRememberedDurations);
    for (const JobState state : {JobState::Running, JobState::Cancelling})
      for (JobRecord& job : reader.list({.state = state}, kNewest, kAll)) held.push_back(std::move(job));
  });
  {
    std::lock_guard lock(mutex_);
    for (const JobRecord& job : queued) waiting_.put(waiting(job));
    queued_ = waiting_.size();
    // Whose turn it is goes on where it was: a restart gives nobody a second turn.
    for (const LastStart& start : starts) waiting_.had_turn(start.submitter, start.priority);
    for (const JobRecord& job : finished)
      if (job.started && job.ended) durations_.add(*job.ended - began_at(job));
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
    const WallTime began = job.begun.value_or(job.started.value_or(clock_.wall()));
    const bool is_in_queue = launcher_.is_batch_system() && !job.process.empty() && !job.begun;
    if (is_in_queue)
      leases_.grant_waiting(key, job.token_hash, clock_.steady(), job.limits);
    else
      leases_.grant(key, job.token_hash, clock_.steady(), job.limits,
                    std::max(clock_.wall() - began, std::chrono::milliseconds(0)));
    if (is_in_queue) progress_[job.id].stage = JobStage::Waiting;
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
      "", [this, job](JobTable& table) { return queue_.submit(table, job, [this] { blobs_.require_room(); }); },
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
        for (const NewJob& job : jobs) made->push_back(queue_.submit(table, job, [this] { blobs_.require_room(); }));
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
  // One that waits in no list any more has been picked, and is about to start.
  view.queue_position = std::max(1, waiting_.position(job.id, now));
  const auto typical = durations_.typical();
  if (!typical) return view;
  std::vector<WallTime> running;
  for (const auto& [key, began] : running_) running.push_back(began);
  const WallTime start = estimate_start(view.queue_position, std::move(running),
                                        settings_.slots + static_cast<int>(takers_.size()), *typical, now);
  view.estimated_start = std::max(start, job.not_before.value_or(start));
  return view;
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
  if (!launcher_.is_batch_system())
    for (const AttemptKey& key : keys) launcher_.terminate(key);
  wake_();
}

void JobManager::set_paused(bool is_paused) {
  is_paused_ = is_paused;
  wake_();
}

bool JobManager::is_drained() const {
  std::lock_guard lock(mutex_);
  const bool has_none = launcher_.is_batch_system() || launcher_.is_idle();
  return is_draining_ && launches_.empty() && !is_dispatching_ && has_none;
}

int JobManager::running_jobs() const {
  std::lock_guard lock(mutex_);
  return leases_.size();
}

JobManager::Use JobManager::use_of_workers() const {
  std::lock_guard lock(mutex_);
  Use use;
  for (const auto& [id, progress] : progress_) {
    use.memory_bytes += progress.memory_bytes;
    use.cpu_seconds += progress.cpu_seconds;
  }
  return use;
}

int JobManager::threads_of(const JobRecord& job) const {
  return job.threads > 0 ? job.threads : settings_.default_threads;
}

Demand JobManager::demand_of(int threads, std::int64_t memory_bytes) const {
  const std::int64_t share =
      settings_.default_memory > 0 ? settings_.default_memory : settings_.memory_budget / std::max(1, settings_.slots);
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
  waiting.attempt = job.attempt;
  // On the clock that never jumps: setting the machine's time must not hold a retry back.
  waiting.ready = clock_.steady();
  if (job.not_before)
    waiting.ready += std::clamp(*job.not_before - clock_.wall(), std::chrono::milliseconds(0),
                                settings_.queue.retry_delay * kLongestRetry);
  return waiting;
}

}  // namespace saltus::server
