#include "server/jobs/job_manager.h"

#include "server/jobs/refusal.h"

#include <algorithm>
#include <future>
#include <limits>
#include <memory>

namespace saltus::server {
namespace {

constexpr auto kNewest = std::numeric_limits<std::int64_t>::max();
constexpr auto kAll = std::numeric_limits<int>::max();

Refusal draining() {
  return {RefusalKind::Unavailable, "DRAINING", "the daemon is shutting down and takes no new jobs; try again later"};
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
  int queued = 0;
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
      leases_(settings.lease, settings.cancel_ladder) {
  launcher_.on_exit([this](const AttemptKey& key, const WorkerExit& exit) { worker_ended(key, exit); });
}

void JobManager::write_change(const std::string& id, std::function<std::optional<JobRecord>(JobTable&)> decide,
                              std::function<void(std::exception_ptr, const Change&)> done) {
  auto change = std::make_shared<Change>();
  store_.write(
      [change, id, decide = std::move(decide)](JobTable& table) {
        change->job = with_checkpoint_dropped(table, id, decide, change->orphans);
        change->queued = table.count(JobState::Queued);
      },
      [this, change, done = std::move(done)](std::exception_ptr error) {
        if (!error) {
          committed(*change);
          if (!change->orphans.empty()) blobs_.drop_bytes(change->orphans);
        }
        done(error, *change);
      });
}

void JobManager::committed(const Change& change) {
  queued_ = change.queued;
  if (!change.job) return;
  const JobRecord& job = *change.job;
  {
    std::lock_guard lock(mutex_);
    if (!is_held(job.state)) {
      const AttemptKey key{job.id, job.attempt};
      leases_.end(key);
      progress_.erase(job.id);
      if (job.attempt > 0) retired_.try_emplace(key, clock_.steady() + settings_.linger);
    } else if (job.state == JobState::Cancelling) {
      leases_.cancel(job.id, clock_.steady());
    }
  }
  log_("job " + job.id + " is " + to_string(job.state) + ", attempt " + std::to_string(job.attempt) +
       (job.failure ? ", " + job.failure->reason : ""));
  watchers_.changed(job);
  wake_();
}

void JobManager::recover() {
  std::vector<JobRecord> held;
  store_.read([&](JobReader& reader) {
    queued_ = reader.count(JobState::Queued);
    for (const JobState state : {JobState::Running, JobState::Cancelling})
      for (JobRecord& job : reader.list(state, kNewest, kAll)) held.push_back(std::move(job));
  });
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
    leases_.grant(key, job.token_hash, clock_.steady());
    if (job.state == JobState::Cancelling) leases_.cancel(job.id, clock_.steady());
  }
}

void JobManager::submit(const NewJob& job, Reply<JobView> reply) {
  if (is_draining_) throw draining();
  if (is_paused_) throw paused();
  auto position = std::make_shared<int>(0);
  write_change(
      "",
      [this, job, position](JobTable& table) {
        JobRecord record = queue_.submit(table, job);
        if (record.state == JobState::Queued) *position = static_cast<int>(table.queued_up_to(record.sequence).size());
        return record;
      },
      [this, position, reply = std::move(reply)](std::exception_ptr error, const Change& change) {
        reply(error, error ? JobView{} : view(*change.job, *position));
      });
}

void JobManager::cancel(const std::string& id, Reply<JobView> reply) {
  write_change(
      id, [this, id](JobTable& table) { return queue_.cancel(table, id); },
      [this, reply = std::move(reply)](std::exception_ptr error, const Change& change) {
        reply(error, error ? JobView{} : view(*change.job, 0));
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
          watchers_.deleted(id);
          blobs_.drop_bytes(*orphans);
        }
        reply(error, id);
      });
}

JobView JobManager::get(const std::string& id) {
  JobRecord job;
  int position = 0;
  store_.read([&](JobReader& reader) {
    job = require_job(reader, id);
    if (job.state == JobState::Queued) position = static_cast<int>(reader.queued_up_to(job.sequence).size());
  });
  return view(job, position);
}

std::vector<JobView> JobManager::list(std::optional<JobState> state, std::int64_t before, int limit) {
  std::vector<JobRecord> jobs;
  std::vector<std::int64_t> queued;
  store_.read([&](JobReader& reader) {
    jobs = reader.list(state, before, limit);
    const auto newest_queued =
        std::find_if(jobs.begin(), jobs.end(), [](const JobRecord& job) { return job.state == JobState::Queued; });
    if (newest_queued != jobs.end()) queued = reader.queued_up_to(newest_queued->sequence);
  });
  std::vector<JobView> views;
  for (const JobRecord& job : jobs) {
    const auto upto = std::upper_bound(queued.begin(), queued.end(), job.sequence);
    views.push_back(view(job, job.state == JobState::Queued ? static_cast<int>(upto - queued.begin()) : 0));
  }
  return views;
}

JobView JobManager::view(const JobRecord& job, int queue_position) const {
  JobView view{job, std::nullopt, queue_position};
  if (is_held(job.state)) {
    std::lock_guard lock(mutex_);
    if (const auto found = progress_.find(job.id); found != progress_.end()) view.progress = found->second;
  }
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

void JobManager::lose(const AttemptKey& key, LossCause cause, const std::string& detail) {
  write_change(
      key.job_id, [this, key, cause, detail](JobTable& table) { return queue_.lose(table, key, cause, detail); },
      [this, key, cause, detail](std::exception_ptr error, const Change& change) {
        std::lock_guard lock(mutex_);
        if (error) {
          // Not recorded: the lease stays, so that its expiry tries once more.
          leases_.retry_expiry(key, clock_.steady());
          return;
        }
        if (!change.job) {
          // The attempt had ended before: nothing was lost, and its lease must not hold a slot.
          leases_.end(key);
          return;
        }
        if (cause != LossCause::Exited || detail != "exit code 0")
          log_("job " + key.job_id + ", attempt " + std::to_string(key.attempt) + ": " + describe(cause, detail));
      });
}

void JobManager::worker_ended(const AttemptKey& key, const WorkerExit& exit) {
  {
    std::lock_guard lock(mutex_);
    retired_.erase(key);
  }
  const std::string number = std::to_string(exit.number);
  if (is_draining_) return lose(key, LossCause::Released, "");
  switch (exit.kind) {
    case WorkerExit::Kind::Exited:
      return lose(key, LossCause::Exited, "exit code " + number);
    case WorkerExit::Kind::Signalled:
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
  // The loss is written before the process is killed: its death must not count as a crash.
  for (const AttemptKey& key : due.expired) {
    lose(key, LossCause::LeaseExpired, "");
    launcher_.kill(key);
  }
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
  {
    std::lock_guard lock(mutex_);
    if (is_dispatching_ || drain_started_ || is_paused_ || queued_ == 0 || leases_.size() >= settings_.slots) return;
    is_dispatching_ = true;
  }
  auto token = std::make_shared<std::string>();
  auto change = std::make_shared<Change>();
  store_.write(
      [this, token, change](JobTable& table) {
        if (auto taken = queue_.take_next(table)) {
          *token = taken->token;
          change->job = std::move(taken->job);
        }
        change->queued = table.count(JobState::Queued);
      },
      [this, token, change](std::exception_ptr error) {
        {
          std::lock_guard lock(mutex_);
          is_dispatching_ = false;
          if (error) return;
          if (change->job) {
            const AttemptKey key{change->job->id, change->job->attempt};
            leases_.grant(key, change->job->token_hash, clock_.steady());
            launches_.push_back({key, *token, threads_of(*change->job), change->job->limits});
          }
        }
        committed(*change);
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

}  // namespace saltus::server
