#pragma once

#include "server/jobs/job_manager.h"
#include "server/jobs/refusal.h"
#include "tests/support/server_fakes.h"

#include <gtest/gtest.h>

namespace saltus::server {

using namespace std::chrono_literals;

/// A manager on a clock that the test moves, with a store in memory and a launcher that starts nothing.
class JobManagerTest : public ::testing::Test {
 protected:
  JobManagerTest() { make_manager(); }

  /// As after a start of the daemon on the same store.
  void make_manager() {
    manager.reset();
    launcher = std::make_unique<testing_support::FakeLauncher>();
    make_manager_of_launcher();
  }
  void make_manager_of_launcher() {
    settings.slots = slots;
    settings.default_threads = 4;
    manager = std::make_unique<JobManager>(
        store, blobs, *launcher, clock, ids, settings, [this] { ++wakes; }, [](const std::string&) {});
  }

  std::string submit(int threads = 0) {
    NewJob job;
    job.threads = threads;
    return submit(job);
  }
  std::string submit(const NewJob& job) {
    std::string id;
    manager->submit(job, [&](std::exception_ptr error, const JobView& view) {
      ASSERT_FALSE(error);
      id = view.job.id;
    });
    return id;
  }
  /// The reason of the refusal, "" when the job was accepted.
  std::string reason_for(const NewJob& job) {
    try {
      manager->submit(job, [](std::exception_ptr error, const JobView&) { ASSERT_FALSE(error); });
    } catch (const Refusal& refusal) {
      return refusal.reason();
    }
    return "";
  }
  /// The delay of every retry is over.
  void wait_for_retry() {
    clock.advance(20s);
    settle();
  }
  std::vector<std::string> started_ids() {
    std::vector<std::string> ids;
    for (const auto& request : launcher->started()) ids.push_back(request.key.job_id);
    return ids;
  }
  /// One tick decides, the next launches.
  void settle() {
    for (int i = 0; i < 4; ++i) manager->tick();
  }
  LaunchRequest submit_and_launch() {
    submit();
    settle();
    return launcher->started().back();
  }
  JobState state(const std::string& id) { return store.table.find(id)->state; }
  void cancel(const std::string& id) {
    manager->cancel(id, [](std::exception_ptr error, const JobView&) { EXPECT_FALSE(error); });
  }
  bool complete(const LaunchRequest& worker, const Outcome& outcome) {
    bool is_done = false;
    manager->complete(worker.key, worker.token, outcome,
                      [&](std::exception_ptr error, const JobRecord&) { is_done = !error; });
    return is_done;
  }

  bool put_checkpoint(const LaunchRequest& worker, const std::string& digest) {
    store.table.insert_blob(digest, 5, clock.wall());
    bool is_done = false;
    manager->put_checkpoint(worker.key, worker.token, {.digest = digest, .size = 5},
                            [&](std::exception_ptr error, const JobRecord&) { is_done = !error; });
    return is_done;
  }

  ManagerSettings settings;
  int slots = 1;
  int wakes = 0;
  testing_support::FakeClock clock;
  testing_support::FakeIds ids;
  testing_support::MemoryStore store;
  testing_support::RecordingBlobs bytes;
  BlobCatalog blobs{store, bytes, clock};
  std::unique_ptr<testing_support::FakeLauncher> launcher;
  std::unique_ptr<JobManager> manager;
};

}  // namespace saltus::server
