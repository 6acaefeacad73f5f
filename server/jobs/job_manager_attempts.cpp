// The half of JobManager that deals with attempts: what workers call, how attempts begin and how they end.
#include "server/jobs/job_manager.h"
#include "server/jobs/refusal.h"

#include <algorithm>
#include <chrono>
#include <iterator>
#include <memory>
#include <utility>

namespace saltus::server {
namespace {

// SIGXCPU: the kernel ends a process that has used up the limit it was given.
constexpr int kProcessorTimeSignal = 24;

// Attempts that are started in one transaction: a commit costs milliseconds, a row microseconds.
constexpr std::size_t kMostPicks = 64;
constexpr std::size_t kMostTakers = 4096;
constexpr std::chrono::milliseconds kTakerRetry{5000};

JobFailure failure_of(Limit limit, const JobLimits& limits) {
  switch (limit) {
    case Limit::WallTime:
      return {"WALL_TIME", "the attempt has taken the " + std::to_string(limits.wall_seconds) +
                               " s that the job allows it; allow more, or choose a faster preset"};
    case Limit::CpuTime:
      return {"CPU_TIME", "the attempt has used the " + std::to_string(limits.cpu_seconds) +
                              " s of processor time that the job allows it; allow more, or choose a faster preset"};
    case Limit::Memory:
      if (limits.memory_bytes == 0)
        return {"MEMORY_LIMIT",
                "the worker found no memory left on its machine; crop the images, or run fewer jobs at the same time"};
      return {"MEMORY_LIMIT", "the worker uses more than the " + gibibytes(limits.memory_bytes) +
                                  " that the job allows it; allow more, or crop the images"};
  }
  return {};
}

JobFailure never_started(const JobRecord& job, int threads, const std::string& reason) {
  const std::int64_t memory = std::max(job.memory_bytes, job.limits.memory_bytes);
  std::string asked = threads == 1 ? "1 thread" : std::to_string(threads) + " threads";
  if (memory > 0) asked += ", " + gibibytes(memory) + " of memory";
  if (job.limits.wall_seconds > 0) asked += ", " + std::to_string(job.limits.wall_seconds) + " s of time";
  return {"BATCH_NEVER_STARTS", "the batch system says that it can never start this job there (" + reason +
                                    "); it asks for " + asked +
                                    ": ask for less, or have the daemon submit to another partition"};
}

}  // namespace

LeaseGrant JobManager::acquire(const AttemptKey& key, const std::string& token, const std::string& worker) {
  bool is_first_word = false;
  {
    std::lock_guard lock(mutex_);
    const auto wanted = leases_.renew(key, ids_.fingerprint(token), clock_.steady());
    if (wanted != LeaseTable::Wanted::Continue || !leases_.is_for(key, worker)) throw lease_lost(key);
    is_first_word = leases_.begin(key, clock_.steady());
  }
  if (is_first_word) has_begun(key);
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
  write_job(
      key.job_id,
      [this, key, token, checkpoint](JobTable& table) { return queue_.put_checkpoint(table, key, token, checkpoint); },
      [reply = std::move(reply)](std::exception_ptr error, const Change& change) {
        reply(error, error ? JobRecord{} : *change.job);
      });
}

LeaseTable::Wanted JobManager::heartbeat(const AttemptKey& key, const std::string& token, const JobProgress& progress) {
  std::optional<LeaseTable::Wanted> wanted;
  bool is_first_word = false;
  {
    std::lock_guard lock(mutex_);
    wanted = leases_.renew(key, ids_.fingerprint(token), clock_.steady());
    if (!wanted) throw lease_lost(key);
    // When the daemon was away while it began, or was started again before that was written down.
    is_first_word = leases_.begin(key, clock_.steady());
    progress_[key.job_id] = progress;
    leases_.progressed(key, progress, clock_.steady());
  }
  if (is_first_word) has_begun(key);
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
  bool is_quiet = cause == LossCause::Exited && detail == "exit code 0";
  if (cause == LossCause::Withdrawn) {
    // By this daemon, because somebody has cancelled the job.
    std::lock_guard lock(mutex_);
    is_quiet = leases_.is_cancelled(key);
  }
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

/// A job that sets itself a limit gets no more time than that. Another one had bad luck with what it was given.
void JobManager::time_limit_reached(const AttemptKey& key) {
  end_attempt(
      key,
      [this, key](JobTable& table) -> std::optional<JobRecord> {
        const auto job = table.find(key.job_id);
        if (!job) return std::nullopt;
        if (job->limits.wall_seconds == 0) return queue_.lose(table, key, LossCause::TimeLimit, "");
        return queue_.fail(table, key, failure_of(Limit::WallTime, job->limits));
      },
      describe(LossCause::TimeLimit, ""), Ending::None);
}

/// Another attempt would ask for the same.
void JobManager::never_starts(const AttemptKey& key, const std::string& reason) {
  end_attempt(
      key,
      [this, key, reason](JobTable& table) -> std::optional<JobRecord> {
        const auto job = table.find(key.job_id);
        return job ? queue_.fail(table, key, never_started(*job, threads_of(*job), reason)) : std::nullopt;
      },
      "the batch system can never start it: " + reason, Ending::None);
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
      if (exit.number == kOutOfMemoryExit) return fail(key, Limit::Memory, Ending::None);
      if (exit.number == kNoRoomExit) return lose(key, LossCause::NoRoom, "");
      return lose(key, LossCause::Exited, "exit code " + number);
    case WorkerExit::Kind::Signalled:
      if (exit.number == kProcessorTimeSignal) return fail(key, Limit::CpuTime, Ending::None);
      return lose(key, LossCause::Crashed, "signal " + number + (exit.detail.empty() ? "" : ", " + exit.detail));
    case WorkerExit::Kind::Vanished:
      return lose(key, LossCause::Vanished, "");
    case WorkerExit::Kind::TimeLimit:
      return time_limit_reached(key);
    case WorkerExit::Kind::Preempted:
      return lose(key, LossCause::Preempted, "");
    case WorkerExit::Kind::NodeFailed:
      return lose(key, LossCause::NodeFailed, "");
    case WorkerExit::Kind::Withdrawn:
      return lose(key, LossCause::Withdrawn, "");
    case WorkerExit::Kind::Refused:
      return lose(key, LossCause::LaunchFailed, exit.detail);
    case WorkerExit::Kind::NeverStarts:
      return never_starts(key, exit.detail);
  }
}

void JobManager::has_news(const AttemptKey& key, const QueueNews& news) {
  std::optional<JobProgress> waiting;
  {
    std::lock_guard lock(mutex_);
    const auto found = progress_.find(key.job_id);
    if (news.has_its_turn) {
      leases_.expect(key, clock_.steady() + settings_.first_call);
      forget_stage(key);
    } else if (running_.contains(key) && found != progress_.end() && found->second.stage == JobStage::Waiting) {
      found->second.waiting_for = news.waiting_for;
      waiting = found->second;
    }
  }
  if (waiting) watchers_.progressed(key.job_id, *waiting);
  if (news.batch_id.empty()) return;
  // Not kept, the number is told again by the next daemon; watchers learn it with the next change.
  write_job(
      key.job_id, [this, key, news](JobTable& table) { return queue_.name(table, key, news.batch_id, news.host); },
      [](std::exception_ptr, const Change&) {});
}

void JobManager::has_begun(const AttemptKey& key) {
  {
    std::lock_guard lock(mutex_);
    running_[key] = clock_.wall();
    forget_stage(key);
    // It has waited in no queue but ours.
    if (remote_.contains(key)) return;
  }
  write_job(
      key.job_id, [this, key](JobTable& table) { return queue_.begin(table, key); },
      // Not kept, the wall time of the attempt begins anew with the next daemon.
      [](std::exception_ptr, const Change&) {});
}

void JobManager::forget_stage(const AttemptKey& key) {
  const auto found = progress_.find(key.job_id);
  if (found != progress_.end() && found->second.stage == JobStage::Waiting) progress_.erase(found);
}

void JobManager::tick() {
  const SteadyTime now = clock_.steady();
  LeaseTable::Due due;
  std::deque<LaunchRequest> launches;
  std::vector<Taker> idle;
  std::vector<AttemptKey> expired, never_begun;
  {
    std::lock_guard lock(mutex_);
    due = leases_.due(now);
    idle = dismissed(now);
    for (const AttemptKey& key : due.expired) {
      const bool has_begun = !remote_.contains(key) || leases_.has_begun(key);
      (has_begun ? expired : never_begun).push_back(key);
    }
    launches.swap(launches_);
    for (auto it = retired_.begin(); it != retired_.end();) {
      if (now < it->second) {
        ++it;
        continue;
      }
      due.kill.push_back(it->first);
      it = retired_.erase(it);
    }
    if (drain_started_ && !launcher_.is_batch_system() && now >= *drain_started_ + settings_.drain_grace)
      for (const AttemptKey& key : leases_.all()) due.kill.push_back(key);
  }
  // A process that does not heed the request to end is killed after `linger`, as every one that outlives its attempt.
  for (const AttemptKey& key : expired) lose(key, LossCause::LeaseExpired, "", Ending::Kill);
  for (const AttemptKey& key : never_begun) lose(key, LossCause::NeverBegun, "");
  for (const Taker& taker : idle) taker.reply(std::nullopt);
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
  // A name that was known before is in the row.
  if (process == launcher_.name_of(key)) return;
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

Fit JobManager::fit_of(const Demand& demand, const Offer& offer) const {
  const bool has_memory = offer.memory_bytes == 0 || demand.memory_bytes <= offer.memory_bytes;
  return has_memory && demand.threads <= offer.threads ? Fit::Yes : Fit::NotHere;
}

std::optional<JobManager::Pick> JobManager::choose() {
  const auto next = [this](const std::function<Fit(const Demand&)>& fits) {
    auto job = waiting_.next(clock_.wall(), clock_.steady(), fits);
    if (!job) return job;
    waiting_.started(job->id);
    waiting_.remove(job->id);
    return job;
  };
  if (budget_.fits({0, 0})) {
    const auto job = next([this](const Demand& demand) { return budget_.fits(demand) ? Fit::Yes : Fit::NotNow; });
    if (job) {
      Pick pick{*job, {}, {}, {}};
      budget_.take(pick.key(), job->demand);
      return pick;
    }
  }
  // Who has waited longest first; who offers what another one has offered in vain need not be asked.
  std::set<Offer> in_vain;
  for (auto it = takers_.begin(); it != takers_.end(); ++it) {
    const Offer& offer = it->second.offer;
    if (in_vain.contains(offer)) continue;
    const auto job = next([&](const Demand& demand) { return fit_of(demand, offer); });
    if (!job) {
      in_vain.insert(offer);
      continue;
    }
    Pick pick{*job, *it, {}, {}};
    takers_.erase(it);
    return pick;
  }
  return std::nullopt;
}

void JobManager::put_back(Pick& pick) {
  if (!pick.taker) budget_.ended(pick.key(), false);
  if (pick.taker) takers_.insert(*pick.taker);
}

void JobManager::start(const Pick& pick) {
  const JobRecord& job = pick.taken->job;
  const AttemptKey key = pick.key();
  const SteadyTime now = clock_.steady();
  running_[key] = *job.started;
  if (pick.taker) {
    leases_.grant_waiting(key, job.token_hash, now, job.limits);
    leases_.expect(key, now + settings_.lease);
    remote_.insert(key);
    return;
  }
  if (is_batch_system_) {
    leases_.grant_waiting(key, job.token_hash, now, job.limits);
    progress_[job.id].stage = JobStage::Waiting;
  } else {
    leases_.grant(key, job.token_hash, now, job.limits);
  }
  launches_.push_back({key, pick.taken->token, pick.job.demand.threads, job.limits, job.memory_bytes});
}

void JobManager::dispatch() {
  auto picks = std::make_shared<std::vector<Pick>>();
  {
    std::lock_guard lock(mutex_);
    if (is_dispatching_ || drain_started_ || is_paused_ || waiting_.size() == 0) return;
    while (picks->size() < kMostPicks) {
      auto pick = choose();
      if (!pick) break;
      if (!pick->taker) pick->process = launcher_.name_of(pick->key());
      picks->push_back(*std::move(pick));
    }
    if (picks->empty()) return;
    is_dispatching_ = true;
  }
  store_.write(
      [this, picks](JobTable& table) {
        for (Pick& pick : *picks)
          pick.taken = queue_.start(table, pick.job.id, [&](const AttemptKey&) { return pick.process; });
      },
      [this, picks](std::exception_ptr error) {
        std::vector<AttemptKey> abandoned;
        {
          std::lock_guard lock(mutex_);
          is_dispatching_ = false;
          for (Pick& pick : *picks) {
            const bool is_abandoned = pick.taker && withdrawn_.erase(pick.taker->first) > 0;
            const bool has_started = !error && pick.taken;
            if (error) waiting_.put(pick.job);
            if (has_started) start(pick);
            if (has_started && is_abandoned) abandoned.push_back(pick.key());
            if (has_started) continue;
            put_back(pick);
            if (is_abandoned) takers_.erase(pick.taker->first);
            pick.taken.reset();
          }
          queued_ = waiting_.size();
        }
        for (const Pick& pick : *picks)
          if (pick.taken) committed(pick.taken->job);
        for (const Pick& pick : *picks)
          if (pick.taken && pick.taker)
            pick.taker->second.reply(TakenJob{pick.key(), pick.taken->token, pick.job.demand.threads});
        for (const AttemptKey& key : abandoned) lose(key, LossCause::NeverBegun, "");
      });
}

std::uint64_t JobManager::take(const Offer& offer, std::chrono::milliseconds wait,
                               std::function<void(const std::optional<TakenJob>&)> reply) {
  std::uint64_t taker = 0;
  {
    std::lock_guard lock(mutex_);
    if (takers_.size() >= kMostTakers)
      throw Refusal(RefusalKind::Exhausted, "TOO_MANY_STREAMS",
                    std::to_string(kMostTakers) + " workers wait for jobs, which is the limit; try again later",
                    kTakerRetry);
    taker = ++last_taker_;
    takers_.emplace(taker, Taker{offer, clock_.steady() + wait, std::move(reply)});
  }
  wake_();
  return taker;
}

void JobManager::withdraw(std::uint64_t taker) {
  Takers::node_type gone;
  {
    std::lock_guard lock(mutex_);
    gone = takers_.extract(taker);
    // Then it is being given a job, or has got its answer.
    if (gone.empty() && is_dispatching_) withdrawn_.insert(taker);
  }
  if (!gone.empty()) gone.mapped().reply(std::nullopt);
}

std::vector<JobManager::Taker> JobManager::dismissed(SteadyTime now) {
  std::vector<Taker> found;
  for (auto it = takers_.begin(); it != takers_.end();) {
    const bool is_over = drain_started_ || now >= it->second.until;
    if (is_over) found.push_back(std::move(it->second));
    it = is_over ? takers_.erase(it) : std::next(it);
  }
  // No round of dispatching is under way that could still come upon them.
  if (!is_dispatching_) withdrawn_.clear();
  return found;
}

void JobManager::report_exit(const AttemptKey& key, const std::string& token, const WorkerExit& exit) {
  {
    std::lock_guard lock(mutex_);
    if (!leases_.is_held_by(key, ids_.fingerprint(token))) return;
  }
  worker_ended(key, exit);
}

}  // namespace saltus::server
