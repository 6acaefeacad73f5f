// The worker's program against a daemon that the test plays.
#include "core/image_io/write_image.h"
#include "tests/support/blob_pair.h"
#include "tests/support/child_process.h"
#include "tests/support/fake_daemon.h"
#include "tests/support/fake_worker_service.h"

#include <gmock/gmock.h>

#include <sys/mount.h>

#include <cerrno>
#include <csignal>
#include <cstring>

namespace saltus::worker {
namespace {

using testing::HasSubstr;
using testing_support::blob_scene;
using testing_support::ChildProcess;
using testing_support::content_of;
using testing_support::ProcessHandle;

class WorkerProcess : public testing::Test {
 protected:
  WorkerProcess() {
    service.terms.set_threads(1);
    service.terms.set_lease_seconds(60);
    service.terms.set_heartbeat_interval_seconds(0.05);
    folder.write("token", "secret");
    std::filesystem::create_directory(folder / "tmp");
    use_images(48);
    auto& settings = *service.terms.mutable_spec()->mutable_settings();
    settings["tolerance"] = "0";
    settings["optimality_tolerance"] = "0";
    settings["max_iterations"] = "60";
    service.terms.mutable_spec()->set_preset("fast");
    service.terms.mutable_spec()->set_output_format("mha");
  }

  void use_images(int extent) {
    const auto upload = [&](const std::string& name, double shift) {
      write_volume(folder / (name + ".mha"), blob_scene(extent, shift));
      return blobs.put(content_of(folder / (name + ".mha")));
    };
    auto& spec = *service.terms.mutable_spec();
    spec.mutable_fixed()->set_digest(upload("fixed", 0));
    spec.mutable_fixed()->set_format("mha");
    spec.mutable_moving()->set_digest(upload("moving", 3));
    spec.mutable_moving()->set_format("mha");
  }
  void make_it_last() {
    auto& settings = *service.terms.mutable_spec()->mutable_settings();
    service.terms.mutable_spec()->set_model("sliding");
    settings["coarsening"] = "0";
    settings["max_iterations"] = "10000";
    settings["levels"] = "1";
    settings["time_steps"] = "64";
    settings["width_voxels"] = "64";
    settings["map_steps"] = "16";
    // One round may end as soon as nothing can be gained in single precision.
    settings["reweighted_rounds"] = "10";
    settings["sparsity_path"] = "12";
  }

  ChildProcess start() {
    return ChildProcess({SALTUS_WORKER, "--server", daemon.settings().address, "--job", "job-1", "--attempt", "1",
                         "--token-file", folder / "token"},
                        {{"TMPDIR", (folder / "tmp").string()}});
  }
  std::string run() {
    ChildProcess worker = start();
    EXPECT_EQ(worker.wait(), 0) << worker.err();
    return worker.err();
  }
  /// Runs until the attempt has put `count` checkpoints in safety, and kills it then.
  v1::Checkpoint killed_after(std::size_t count) {
    service.terms.set_checkpoint_interval_seconds(0.001);
    service.checkpoints.clear();
    ChildProcess worker = start();
    v1::Checkpoint last;
    bool is_over = false;
    service.wait_until([&] {
      if (!service.checkpoints.empty()) last = service.checkpoints.back();
      is_over = service.outcome.has_value();
      return service.checkpoints.size() >= count || is_over;
    });
    EXPECT_FALSE(is_over) << "the work was over too early to show anything";
    worker.signal(SIGKILL);
    EXPECT_EQ(worker.wait(), 128 + SIGKILL);
    return last;
  }
  std::map<std::string, std::string> results() const {
    std::map<std::string, std::string> digests;
    for (const v1::Artifact& artifact : service.outcome->success().artifacts())
      digests[artifact.name()] = artifact.digest();
    return digests;
  }
  void expect_same_results(const std::map<std::string, std::string>& expected) {
    ASSERT_TRUE(service.outcome && service.outcome->has_success());
    const auto found = results();
    for (const char* name : {"displacement.mha", "inverse_displacement.mha", "momentum_1_order0.mha"})
      EXPECT_EQ(found.at(name), expected.at(name)) << name;
  }

  testing_support::TemporaryFolder folder;
  testing_support::FakeBlobs blobs;
  testing_support::FakeWorkerService service;
  testing_support::FakeDaemon daemon{&blobs, &service};
};

TEST_F(WorkerProcess, GoesOnFromACheckpointToTheSameBits) {
  auto& settings = *service.terms.mutable_spec()->mutable_settings();
  settings["max_iterations"] = "100";
  settings["time_steps"] = "64";  // so that it is heard of before it has ended
  settings["map_steps"] = "8";
  run();
  const auto expected = results();
  service.outcome.reset();

  *service.terms.mutable_checkpoint() = killed_after(2);
  service.terms.clear_checkpoint_interval_seconds();
  bool is_resumed = false;
  ChildProcess second = start();
  service.wait_until([&] {
    is_resumed = is_resumed || service.last_heartbeat.progress().is_resumed();
    return service.outcome.has_value();
  });
  EXPECT_EQ(second.wait(), 0) << second.err();
  EXPECT_TRUE(is_resumed);
  EXPECT_EQ(second.err(), "");
  expect_same_results(expected);
}

TEST_F(WorkerProcess, DropsACheckpointOfAnotherJobAndSaysSo) {
  run();
  const auto expected = results();
  service.outcome.reset();
  auto& settings = *service.terms.mutable_spec()->mutable_settings();
  settings["regularisation"] = "0.5";
  *service.terms.mutable_checkpoint() = killed_after(1);
  settings.erase("regularisation");
  EXPECT_THAT(run(), HasSubstr("the checkpoint is dropped: the checkpoint belongs to another registration"));
  expect_same_results(expected);
}

TEST_F(WorkerProcess, DropsACheckpointThatIsNoneOrNotThere) {
  run();
  const auto expected = results();
  for (const std::string& digest : {blobs.put("no checkpoint"), testing_support::digest_of("never stored")}) {
    service.outcome.reset();
    service.terms.mutable_checkpoint()->set_digest(digest);
    EXPECT_THAT(run(), HasSubstr("the checkpoint is dropped"));
    expect_same_results(expected);
  }
}

TEST_F(WorkerProcess, FailsWithMemoryLimitWhenItNeedsMoreThanItMay) {
  use_images(1000);
  service.terms.mutable_limits()->set_memory_bytes(8 << 20);
  run();
  ASSERT_TRUE(service.outcome && service.outcome->has_failure());
  EXPECT_EQ(service.outcome->failure().reason(), "MEMORY_LIMIT") << service.outcome->failure().message();
  EXPECT_TRUE(std::filesystem::is_empty(folder / "tmp"));
}

// What the daemon sees when nobody can tell it.
TEST_F(WorkerProcess, EndsWithACodeOfItsOwnWhenWantOfMemoryCannotBeReported) {
  use_images(1000);
  service.terms.mutable_limits()->set_memory_bytes(8 << 20);
  service.completion = {grpc::StatusCode::INTERNAL, "a fault of the daemon"};
  ChildProcess worker = start();
  EXPECT_EQ(worker.wait(), 6) << worker.err();
  service.is_lost = true;
  service.completion = {grpc::StatusCode::ABORTED, "the attempt is no longer wanted"};
  ChildProcess lost = start();
  EXPECT_EQ(lost.wait(), 4) << lost.err();
}

TEST_F(WorkerProcess, WaitsForRoomForItsResults) {
  blobs.fill_disk(5, std::chrono::milliseconds(1));
  run();
  ASSERT_TRUE(service.outcome && service.outcome->has_success());
  EXPECT_EQ(blobs.refusals_left(), 0);
  for (const auto& [name, digest] : results()) EXPECT_FALSE(blobs.get(digest).empty()) << name;
}

// No worker waits until the next day.
TEST_F(WorkerProcess, EndsWithACodeOfItsOwnWhenThereWillBeNoRoomForItsResults) {
  blobs.fill_disk(1000, std::chrono::hours(24));
  ChildProcess worker = start();
  EXPECT_EQ(worker.wait(), 7) << worker.err();
  EXPECT_FALSE(service.outcome);
  EXPECT_TRUE(std::filesystem::is_empty(folder / "tmp"));
}

// Another attempt would end there as well.
TEST_F(WorkerProcess, FailsWhereItsResultsAreLargerThanAFileMayBe) {
  blobs.limit_files();
  run();
  ASSERT_TRUE(service.outcome && service.outcome->has_failure());
  EXPECT_EQ(service.outcome->failure().reason(), "FILE_TOO_LARGE");
  EXPECT_THAT(service.outcome->failure().message(), HasSubstr("no file may be so large"));
}

TEST_F(WorkerProcess, FailsWithCpuTimeWhenItUsesMoreThanItMay) {
  make_it_last();
  service.terms.mutable_limits()->set_cpu_seconds(1);
  run();
  ASSERT_TRUE(service.outcome && service.outcome->has_failure());
  EXPECT_EQ(service.outcome->failure().reason(), "CPU_TIME");
  EXPECT_TRUE(std::filesystem::is_empty(folder / "tmp"));
}

TEST_F(WorkerProcess, WhatComesBackAfterItsLeaseIsLostEndsWithoutOutput) {
  make_it_last();
  ChildProcess worker = start();
  service.wait_until([&] { return service.last_heartbeat.progress().stage() == v1::JOB_STAGE_OPTIMISING; });
  worker.signal(SIGSTOP);
  service.is_lost = true;
  worker.signal(SIGCONT);
  EXPECT_EQ(worker.wait(), 4) << worker.err();
  EXPECT_FALSE(service.outcome);
  EXPECT_TRUE(std::filesystem::is_empty(folder / "tmp"));
}

// The job is not to blame: the attempt is lost, and the next one, where there is room, ends it.
TEST_F(WorkerProcess, WithoutRoomForTemporaryFilesTheAttemptIsLostAndTheJobIsNot) {
  const auto place = folder / "tmp";
  if (mount("none", place.c_str(), "tmpfs", 0, "size=64k") != 0)
    GTEST_SKIP() << "a file system cannot be mounted here: " << std::strerror(errno);
  struct Unmount {
    std::filesystem::path path;
    ~Unmount() { umount2(path.c_str(), MNT_DETACH); }
  } unmount{place};
  service.terms.mutable_spec()->mutable_settings()->at("max_iterations") = "3";
  ChildProcess worker = start();
  EXPECT_EQ(worker.wait(), 7) << worker.err();
  EXPECT_THAT(worker.err(), HasSubstr("no room for temporary files"));
  EXPECT_FALSE(service.outcome);
}

TEST_F(WorkerProcess, TellsWhatItUsesAndStaysWithinSmallLimits) {
  make_it_last();
  ChildProcess worker = start();
  v1::JobProgress progress;
  service.wait_until([&] {
    progress = service.last_heartbeat.progress();
    return progress.stage() == v1::JOB_STAGE_OPTIMISING && progress.cpu_seconds() > 0;
  });
  EXPECT_GT(progress.memory_bytes(), 1 << 20);
  EXPECT_LT(progress.memory_bytes(), std::int64_t{8} << 30);
  const std::string process = "/proc/" + std::to_string(worker.id());
  EXPECT_EQ(content_of(process + "/oom_score_adj"), "500\n");
  const std::string limits = content_of(process + "/limits");
  EXPECT_THAT(limits, testing::ContainsRegex("Max core file size +0 +0 "));
  EXPECT_THAT(limits, testing::ContainsRegex("Max open files +1024 +1024 "));
  worker.signal(SIGKILL);
  worker.wait();
}

}  // namespace
}  // namespace saltus::worker
