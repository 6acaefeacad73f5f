// Random calls against the job manager, beside a model that is too simple to be wrong: what a client was told must stay
// so, and every state must be the one that the diagram in server/README.md says.
#include "server/jobs/job_manager.h"
#include "server/jobs/refusal.h"
#include "tests/support/server_fakes.h"

#include <gtest/gtest.h>

#include <random>

namespace saltus::server {
namespace {

using namespace std::chrono_literals;

constexpr int kSlots = 3;
constexpr int kSteps = 400;
constexpr auto kLease = 30s;

/// What a client knows of a job, and what the rules say about it.
struct Known {
  JobState state = JobState::Queued;
  int attempt = 0;
  int lost = 0;
  int crashes = 0;
  std::string token;  ///< of the current attempt
  std::optional<std::string> checkpoint;
  std::optional<SteadyTime> heard;      ///< last sign of life of the current attempt
  std::optional<SteadyTime> not_until;  ///< of the next attempt
};

class JobModel : public ::testing::TestWithParam<unsigned> {
 protected:
  JobModel() : random(GetParam()) { start_daemon({}); }

  int pick(int count) { return static_cast<int>(random() % static_cast<unsigned>(count)); }

  void start_daemon(std::set<AttemptKey> adoptable) {
    manager.reset();
    launcher = std::make_unique<testing_support::FakeLauncher>();
    launcher->adoptable = std::move(adoptable);
    ManagerSettings settings;
    settings.slots = kSlots;
    settings.lease = kLease;
    settings.stall_timeout = 24h;
    settings.queue.max_queued = 12;
    manager = std::make_unique<JobManager>(
        store, blobs, *launcher, clock, ids, settings, [] {}, [](const auto&) {});
    manager->recover();
    seen_starts = 0;
  }

  std::string any_job() {
    if (known.empty()) return "nobody";
    return std::next(known.begin(), pick(static_cast<int>(known.size())))->first;
  }
  /// An attempt that was launched at some time: often not the current one any more.
  std::optional<LaunchRequest> any_attempt() {
    if (launched.empty()) return std::nullopt;
    const int newest = std::min(4, static_cast<int>(launched.size()));
    return launched[launched.size() - 1 - static_cast<std::size_t>(pick(newest))];
  }
  bool is_current(const LaunchRequest& attempt) {
    const auto found = known.find(attempt.key.job_id);
    return found != known.end() && found->second.attempt == attempt.key.attempt && is_held(found->second.state);
  }

  void expect_lost(Known& job, bool is_crash) {
    job.heard.reset();
    if (is_crash) ++job.crashes;
    ++job.lost;
    if (job.state == JobState::Cancelling)
      end(job, JobState::Cancelled);
    else if (job.lost >= 3 || job.crashes >= 2)
      end(job, JobState::Failed);
    else {
      job.state = JobState::Queued;
      job.not_until = clock.steady() + (job.lost == 1 ? 5s : 20s);
    }
  }
  static void end(Known& job, JobState state) {
    job.state = state;
    job.heard.reset();
    job.not_until.reset();
    job.checkpoint.reset();
  }

  void submit() {
    NewJob job;
    job.submitter = pick(2) ? "ann" : "bob";
    job.priority = pick(3);
    job.request_id = "request " + std::to_string(pick(60));
    job.request_hash = std::to_string(pick(2));
    const auto earlier = requests.find({job.submitter, job.request_id});
    const bool is_repeat = earlier != requests.end() && known.contains(earlier->second.id);
    std::string reason, id;
    manager->submit(job, [&](std::exception_ptr error, const JobView& view) {
      try {
        if (error) std::rethrow_exception(error);
        id = view.job.id;
      } catch (const Refusal& refusal) {
        reason = refusal.reason();
      }
    });
    if (is_repeat) {
      if (earlier->second.hash == job.request_hash)
        EXPECT_EQ(id, earlier->second.id);
      else
        EXPECT_EQ(reason, "REQUEST_ID_REUSED");
      return;
    }
    const auto queued = std::count_if(known.begin(), known.end(),
                                      [](const auto& entry) { return entry.second.state == JobState::Queued; });
    EXPECT_EQ(reason, queued >= 12 ? "QUEUE_FULL" : "");
    if (!reason.empty()) return;
    requests[{job.submitter, job.request_id}] = {id, job.request_hash};
    known[id] = {};
  }

  void cancel() {
    const std::string id = any_job();
    bool is_done = false;
    manager->cancel(id, [&](std::exception_ptr error, const JobView&) { is_done = !error; });
    const auto found = known.find(id);
    EXPECT_EQ(is_done, found != known.end());
    if (found == known.end()) return;
    if (found->second.state == JobState::Queued) end(found->second, JobState::Cancelled);
    if (found->second.state == JobState::Running) found->second.state = JobState::Cancelling;
  }

  void remove() {
    const std::string id = any_job();
    bool is_done = false;
    manager->remove(id, [&](std::exception_ptr error, const std::string&) { is_done = !error; });
    const auto found = known.find(id);
    EXPECT_EQ(is_done, found != known.end() && !is_held(found->second.state));
    if (is_done) known.erase(found);
  }

  void heartbeat() {
    const auto attempt = any_attempt();
    if (!attempt) return;
    bool is_granted = true, is_cancel = false;
    try {
      is_cancel = manager->heartbeat(attempt->key, attempt->token, {}) == LeaseTable::Wanted::Cancel;
    } catch (const Refusal&) {
      is_granted = false;
    }
    EXPECT_EQ(is_granted, is_current(*attempt));
    if (!is_granted) return;
    Known& job = known.at(attempt->key.job_id);
    EXPECT_EQ(is_cancel, job.state == JobState::Cancelling);
    job.heard = clock.steady();
  }

  void complete() {
    const auto attempt = any_attempt();
    if (!attempt) return;
    const int kind = pick(3);
    const bool is_forged = pick(5) == 0;
    Outcome outcome = Delivered{};
    if (kind == 1) outcome = JobFailure{"DIVERGED", "it diverged"};
    if (kind == 2) outcome = Stopped{};
    bool is_done = false;
    const bool was_current = is_current(*attempt);
    manager->complete(attempt->key, is_forged ? "forged" : attempt->token, outcome,
                      [&](std::exception_ptr error, const JobRecord&) { is_done = !error; });
    if (!was_current || is_forged) {
      // A repeated outcome is allowed, and changes nothing: check() sees to that.
      EXPECT_FALSE(is_forged && is_done);
      return;
    }
    EXPECT_TRUE(is_done);
    Known& job = known.at(attempt->key.job_id);
    if (kind == 0)
      end(job, JobState::Succeeded);
    else if (job.state == JobState::Cancelling)
      end(job, JobState::Cancelled);
    else if (kind == 1)
      end(job, JobState::Failed);
    else
      expect_lost(job, false);
  }

  void put_checkpoint() {
    const auto attempt = any_attempt();
    if (!attempt) return;
    const std::string digest = "sha256:" + std::to_string(++checkpoints);
    store.table.insert_blob(digest, 5, clock.wall());
    bool is_done = false;
    manager->put_checkpoint(attempt->key, attempt->token, {.digest = digest, .size = 5},
                            [&](std::exception_ptr error, const JobRecord&) { is_done = !error; });
    EXPECT_EQ(is_done, is_current(*attempt));
    if (is_done) known.at(attempt->key.job_id).checkpoint = digest;
  }

  void end_process() {
    const auto attempt = any_attempt();
    if (!attempt || ended.contains(attempt->key)) return;
    const bool is_crash = pick(2);
    const bool was_current = is_current(*attempt);
    launcher->end(attempt->key,
                  is_crash ? WorkerExit{WorkerExit::Kind::Signalled, 11} : WorkerExit{WorkerExit::Kind::Exited, 1});
    ended.insert(attempt->key);
    if (was_current) expect_lost(known.at(attempt->key.job_id), is_crash);
  }

  void pass_time() {
    clock.advance(std::chrono::milliseconds(pick(2) ? pick(3000) : pick(25000)));
    for (auto& [id, job] : known)
      if (is_held(job.state) && clock.steady() >= *job.heard + kLease) expect_lost(job, false);
  }

  void restart() {
    std::set<AttemptKey> alive;
    for (auto& [id, job] : known) {
      if (!is_held(job.state)) continue;
      const AttemptKey key{id, job.attempt};
      if (!ended.contains(key) && pick(2)) {
        alive.insert(key);
        job.heard = clock.steady();
      } else {
        expect_lost(job, false);
        ended.insert(key);
      }
    }
    // Processes of attempts that are over are of no interest to the next daemon.
    for (const LaunchRequest& attempt : launched)
      if (!alive.contains(attempt.key)) ended.insert(attempt.key);
    start_daemon(alive);
  }

  /// Lets the manager start what it wants and checks that it may.
  void tick() {
    for (int i = 0; i < 2 * kSlots + 2; ++i) manager->tick();
    const auto starts = launcher->started();
    for (; seen_starts < starts.size(); ++seen_starts) {
      const LaunchRequest& start = starts[seen_starts];
      ASSERT_TRUE(known.contains(start.key.job_id));
      Known& job = known.at(start.key.job_id);
      EXPECT_EQ(job.state, JobState::Queued) << start.key.job_id;
      EXPECT_EQ(start.key.attempt, job.attempt + 1);
      EXPECT_GE(clock.steady(), job.not_until.value_or(clock.steady()));
      job.state = JobState::Running;
      job.attempt = start.key.attempt;
      job.token = start.token;
      job.heard = clock.steady();
      job.not_until.reset();
      launched.push_back(start);
      EXPECT_EQ(manager->acquire(start.key, start.token).checkpoint.has_value(), job.checkpoint.has_value());
    }
  }

  void check() {
    int held = 0, queued = 0, ready = 0;
    for (const auto& [id, job] : known) {
      const auto row = store.table.find(id);
      ASSERT_TRUE(row.has_value()) << id << " is gone";
      ASSERT_EQ(to_string(row->state), to_string(job.state)) << id;
      ASSERT_EQ(row->attempt, job.attempt) << id;
      ASSERT_EQ(row->lost_attempts, job.lost) << id;
      ASSERT_EQ(row->crashes, job.crashes) << id;
      ASSERT_EQ(row->checkpoint ? std::optional(row->checkpoint->digest) : std::nullopt, job.checkpoint) << id;
      ASSERT_EQ(row->failure.has_value(), job.state == JobState::Failed) << id;
      ASSERT_EQ(row->ended.has_value(), is_terminal(job.state)) << id;
      held += is_held(job.state);
      queued += job.state == JobState::Queued;
      ready += job.state == JobState::Queued && (!job.not_until || clock.steady() >= *job.not_until);
      EXPECT_EQ(manager->get(id).queue_position > 0, job.state == JobState::Queued) << id;
    }
    EXPECT_EQ(store.table.list({}, 1 << 30, 1 << 30).size(), known.size());
    EXPECT_LE(held, kSlots);
    EXPECT_EQ(manager->queued_jobs(), queued);
    // Nobody waits beside a free slot; workers that are being ended by force still hold theirs.
    const bool all_processes_over = static_cast<int>(launched.size()) == static_cast<int>(ended.size()) + held;
    EXPECT_TRUE(!all_processes_over || held == kSlots || ready == 0);
  }

  struct Request {
    std::string id, hash;
  };
  std::mt19937 random;
  testing_support::FakeClock clock;
  testing_support::FakeIds ids;
  testing_support::MemoryStore store;
  testing_support::RecordingBlobs bytes;
  BlobCatalog blobs{store, bytes, clock};
  std::unique_ptr<testing_support::FakeLauncher> launcher;
  std::unique_ptr<JobManager> manager;
  std::map<std::string, Known> known;
  std::map<std::pair<std::string, std::string>, Request> requests;
  std::vector<LaunchRequest> launched;
  std::set<AttemptKey> ended;
  std::size_t seen_starts = 0;
  int checkpoints = 0;
};

TEST_P(JobModel, WhatWasAcknowledgedStaysSo) {
  for (int step = 0; step < kSteps && !HasFatalFailure(); ++step) {
    SCOPED_TRACE("step " + std::to_string(step));
    switch (pick(20)) {
      case 0:
        restart();
        break;
      case 1:
      case 2:
        cancel();
        break;
      case 3:
        remove();
        break;
      case 4:
      case 5:
      case 6:
        complete();
        break;
      case 7:
      case 8:
        end_process();
        break;
      case 9:
      case 10:
        put_checkpoint();
        break;
      case 11:
      case 12:
        heartbeat();
        break;
      case 13:
      case 14:
      case 15:
        pass_time();
        break;
      default:
        submit();
        break;
    }
    tick();
    check();
  }
}

INSTANTIATE_TEST_SUITE_P(Seeds, JobModel, ::testing::Range(1u, 41u));

}  // namespace
}  // namespace saltus::server
