// What becomes of a job whose worker crashes, hangs, stops, ends too early or runs out of what it may use.
#include "tests/end_to_end/end_to_end.h"

#include <sys/stat.h>

#include <csignal>
#include <fstream>

namespace saltus {
namespace {

using nlohmann::json;
using testing::HasSubstr;
using testing_support::ChildProcess;
using testing_support::Outcome;
using testing_support::ServerTest;

const std::string faulty_worker = SALTUS_FAULTY_WORKER;

/// A daemon whose workers do what core/support/failpoint.h describes.
class FaultTest : public ServerTest {
 protected:
  FaultTest() { daemon_options = {"--worker", faulty_worker, "--retry-seconds", "0", "--checkpoint-seconds", "0.001"}; }
  void SetUp() override { EndToEnd::SetUp(); }
  void TearDown() override {
    daemon->signal(SIGTERM);
    EXPECT_EQ(daemon->wait(), 0);
    EXPECT_TRUE(std::filesystem::is_empty(folder / "data" / "work")) << "a worker left files";
  }

  /// Every worker comes to the fault, or only the first.
  void start_with(const std::string& fault, bool only_once = true) {
    daemon_environment = {{"SALTUS_FAILPOINT", fault}};
    if (only_once) daemon_environment["SALTUS_FAILPOINT_ONCE"] = folder.write("once", "").string();
    start_daemon();
  }
  /// A job that is lost once, which the second attempt does; the job at its end.
  json lost_once() {
    const std::string id = submit();
    const Outcome watched = run(here({"watch", id}));
    EXPECT_EQ(watched.exit_code, 0) << watched.err;
    EXPECT_FALSE(std::filesystem::exists(folder / "once")) << "the fault did not happen";
    const json job = get(id);
    EXPECT_EQ(job["attempt"], 2);
    EXPECT_EQ(run(here({"fetch", id, "--out", folder / "out"})).exit_code, 0);
    expect_shift(folder / "out" / "displacement.mha");
    return job;
  }
  /// A job that fails; the job at its end.
  json failed(const std::vector<std::string>& options) {
    const std::string id = submit(options);
    EXPECT_EQ(run(here({"watch", id})).exit_code, 1);
    const json job = get(id);
    EXPECT_EQ(job["state"], "FAILED");
    return job;
  }
  static std::vector<std::string> with(std::vector<std::string> options, const std::vector<std::string>& more) {
    options.insert(options.end(), more.begin(), more.end());
    return options;
  }
};

TEST_F(FaultTest, AWorkerThatCrashesIsReplaced) {
  start_with("worker.iteration:3=segv");
  EXPECT_EQ(lost_once()["last_loss"]["reason"], "WORKER_CRASHED");
}

TEST_F(FaultTest, AJobThatCrashesEachWorkerIsGivenUpAfterTheSecond) {
  start_with("worker.iteration:3=segv", false);
  const json job = failed(of_a_moment());
  EXPECT_EQ(job["failure"]["reason"], "WORKER_CRASHED");
  EXPECT_EQ(job["attempt"], 2);
}

TEST_F(FaultTest, AWorkerThatEndsWellWithoutAResultIsReplaced) {
  start_with("worker.complete.before=exit");
  EXPECT_EQ(lost_once()["last_loss"]["reason"], "WORKER_EXITED");
}

// The worker's heartbeat goes on all the time: it is the iteration that stands still.
TEST_F(FaultTest, ASolverThatHangsIsEndedAndReplaced) {
  daemon_options = with(daemon_options, {"--stall-seconds", "10"});
  start_with("worker.iteration:3=hang");
  EXPECT_EQ(lost_once()["last_loss"]["reason"], "STALLED");
}

TEST_F(FaultTest, WantOfMemoryInAParallelLoopFailsTheJobWithItsReason) {
  start_with("worker.iteration:3=new", false);
  const json job = failed(with(of_a_moment(), {"--memory-limit", "0.25"}));
  EXPECT_EQ(job["failure"]["reason"], "MEMORY_LIMIT");
  EXPECT_THAT(job["failure"]["message"].get<std::string>(), HasSubstr("more memory than it may use"));
  EXPECT_EQ(job["attempt"], 1) << "the next attempt would end the same way";
}

// There is nothing to catch, and nobody left to tell the daemon but the exit code.
TEST_F(FaultTest, WantOfMemoryInALibraryOfCFailsTheJobWithItsReason) {
  start_with("worker.iteration:3=malloc", false);
  const json job = failed(with(of_a_moment(), {"--memory-limit", "0.25"}));
  EXPECT_EQ(job["failure"]["reason"], "MEMORY_LIMIT");
  EXPECT_THAT(job["failure"]["message"].get<std::string>(), HasSubstr("that the job allows it"));
  EXPECT_EQ(job["attempt"], 1);
}

TEST_F(FaultTest, AJobThatTakesMoreProcessorTimeThanItMayFails) {
  start_with("worker.iteration:3=spin", false);
  const json job = failed(with(of_a_moment(), {"--cpu-time", "0.03"}));
  EXPECT_EQ(job["failure"]["reason"], "CPU_TIME");
  EXPECT_EQ(job["attempt"], 1);
}

TEST_F(FaultTest, AJobThatTakesLongerThanItMayFails) {
  start_with("worker.iteration:3=hang", false);
  const json job = failed(with(of_a_moment(), {"--wall-time", "0.03"}));
  EXPECT_EQ(job["failure"]["reason"], "WALL_TIME");
  EXPECT_EQ(job["attempt"], 1);
}

// The worker is not the daemon's process, so that nobody can end it while it stands still. It comes back with all its
// results sent and the last call on its lips.
TEST_F(FaultTest, AWorkerThatComesBackAfterItsLeaseChangesNothing) {
  const auto script = folder.write(
      "worker", "#!/bin/sh\nif [ -e '" + (folder / "token").string() + "' ]; then exec '" + faulty_worker +
                    "' \"$@\"; fi\n" + "for word; do last=$word; done\ncp \"$last\" '" + (folder / "token").string() +
                    "'\necho > '" + (folder / "started").string() + "'\nexec sleep 1000\n");
  std::filesystem::permissions(script, std::filesystem::perms::owner_all);
  ASSERT_EQ(mkfifo((folder / "started").c_str(), 0600), 0);
  daemon_options = {"--worker", script, "--retry-seconds", "0", "--lease-seconds", "2"};
  start_daemon();
  const std::string id = submit();
  testing_support::content_of(folder / "started");
  auto variables = environment();
  variables["SALTUS_FAILPOINT"] = "worker.complete.before=stop";
  ChildProcess zombie(
      {faulty_worker, "--server", address, "--job", id, "--attempt", "1", "--token-file", folder / "token"}, variables);
  zombie.wait_for_output("failpoint worker.complete.before");

  EXPECT_EQ(run(here({"watch", id})).exit_code, 0);
  const json before = get(id);
  EXPECT_EQ(before["attempt"], 2);
  EXPECT_EQ(before["last_loss"]["reason"], "LEASE_EXPIRED");
  zombie.signal(SIGCONT);
  EXPECT_EQ(zombie.wait(), 4) << zombie.err();
  EXPECT_EQ(get(id), before);
  EXPECT_EQ(run(here({"fetch", id, "--out", folder / "out"})).exit_code, 0);
  expect_shift(folder / "out" / "displacement.mha");
}

}  // namespace
}  // namespace saltus
