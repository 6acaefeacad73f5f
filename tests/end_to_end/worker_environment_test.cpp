#include "server/launch/worker_environment.h"
#include "core/support/available_cores.h"
#include "tests/end_to_end/end_to_end.h"

#include <algorithm>
#include <csignal>
#include <fstream>
#include <iterator>
#include <map>
#include <utility>

namespace saltus {
namespace {

using testing_support::ChildProcess;
using testing_support::content_of;
using testing_support::EndToEnd;
using testing_support::programs;

/// What `saltus register` gives to the environment of its worker.
class WorkerOfRegister : public EndToEnd {
 protected:
  void SetUp() override {
    EndToEnd::SetUp();
    std::filesystem::create_directory(folder / "bin");
    script("saltusd", programs + "/saltusd \"$@\" --worker " + (folder / "bin" / "worker").string());
    script("worker", programs + "/saltus-worker \"$@\"",
           "echo $GOMP_SPINCOUNT > " + (folder / "turns").string() + "; grep Cpus_allowed_list /proc/self/status > " +
               (folder / "cores").string());
  }

  ChildProcess start_with(int threads, const std::vector<std::string>& what,
                          const std::map<std::string, std::string>& more = {}) const {
    std::vector<std::string> command = job({programs + "/saltus", "register", "--out", folder / "out"}, what);
    *std::next(std::find(command.begin(), command.end(), "--threads")) = std::to_string(threads);
    auto variables = environment();
    variables["SALTUS_BIN"] = folder / "bin";
    variables.insert(more.begin(), more.end());
    return ChildProcess(command, variables);
  }
  std::string turns() const { return content_of(folder / "turns"); }

 private:
  void script(const std::string& name, const std::string& program, const std::string& before = ":") const {
    const std::filesystem::path file = folder / "bin" / name;
    std::ofstream(file) << "#!/bin/sh\n" << before << "\nexec " << program << "\n";
    std::filesystem::permissions(file, std::filesystem::perms::owner_all);
  }
};

TEST_F(WorkerOfRegister, ThreadsWaitAwakeWhereThereIsACoreForEach) {
  const int cores = available_cores();
  for (const auto& [threads, expected] :
       {std::pair(0, server::kBriefWait), {1, server::kBriefWait}, {cores + 1, "0"}}) {
    SCOPED_TRACE(threads);
    ChildProcess child = start_with(threads, of_a_moment());
    EXPECT_EQ(child.wait(), 0) << child.err();
    EXPECT_EQ(turns(), std::string(expected) + "\n");
  }
}

TEST_F(WorkerOfRegister, ThreadsSleepWhileAnotherRegistrationRuns) {
  ChildProcess before = start_with(1, of_minutes());
  before.wait_for_output("iteration");
  EXPECT_EQ(turns(), std::string(server::kBriefWait) + "\n");
  ChildProcess child = start_with(1, of_a_moment());
  EXPECT_EQ(child.wait(), 0) << child.err();
  EXPECT_EQ(turns(), "0\n");
  before.signal(SIGINT);
  EXPECT_EQ(before.wait(), 4);
  ChildProcess after = start_with(1, of_a_moment());
  EXPECT_EQ(after.wait(), 0) << after.err();
  EXPECT_EQ(turns(), std::string(server::kBriefWait) + "\n");
}

// OpenMP binds the first thread of `saltus` and of `saltusd` to one core; neither may hand that on.
TEST_F(WorkerOfRegister, HasAllCoresWhereverThreadsAreToBeBound) {
  std::ifstream status("/proc/self/status");
  std::string own;
  while (own.find("Cpus_allowed_list") != 0) ASSERT_TRUE(std::getline(status, own));
  for (const std::pair<const std::string, std::string>& bound :
       {std::pair<const std::string, std::string>("OMP_PROC_BIND", "true"), {"GOMP_CPU_AFFINITY", "0-1023"}}) {
    SCOPED_TRACE(bound.first);
    ChildProcess child = start_with(0, of_a_moment(), {bound});
    EXPECT_EQ(child.wait(), 0) << child.err();
    EXPECT_EQ(content_of(folder / "cores"), own + "\n");
  }
}

}  // namespace
}  // namespace saltus
