#include "tests/benchmark/measured_process.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <iterator>
#include <stdexcept>

#include "tests/support/temporary_folder.h"

namespace saltus::benchmark {
namespace {

std::string text_of(const std::filesystem::path& path) {
  std::ifstream file(path);
  return {std::istreambuf_iterator<char>(file), {}};
}

class MeasuredProcess : public ::testing::Test {
 protected:
  testing_support::TemporaryFolder folder_;
  const std::filesystem::path log_ = folder_.path() / "log";
  ProcessCost run(const std::string& script, const std::map<std::string, std::string>& environment = {}) {
    return run_measured({"sh", "-c", script}, environment, log_);
  }
};

TEST_F(MeasuredProcess, GivesExitCodesSignalsAndOutput) {
  EXPECT_EQ(run("echo one; echo two >&2; exit 3").exit_code, 3);
  EXPECT_EQ(text_of(log_), "one\ntwo\n");
  EXPECT_EQ(run("kill -TERM $$").exit_code, 128 + 15);
  EXPECT_EQ(run("test \"$SALTUS_TEST\" = here", {{"SALTUS_TEST", "here"}}).exit_code, 0);
  EXPECT_EQ(std::getenv("SALTUS_TEST"), nullptr);
  EXPECT_EQ(run("read line").exit_code, 1) << "its input is empty";
}

// Oracle: the same loop in the process itself and in a grandchild that it waits for.
TEST_F(MeasuredProcess, CountsTheWorkOfDescendants) {
  const std::string loop = "i=0; while [ $i -lt 100000 ]; do i=$((i+1)); done";
  const double nothing = run("true").cpu_seconds, own = run(loop).cpu_seconds,
               descendants = run("sh -c '" + loop + "; true'; true").cpu_seconds;
  EXPECT_GT(own, 5 * nothing);
  EXPECT_GT(descendants, 0.3 * own);
}

// Oracle: what a program holds, made by one that has to.
TEST_F(MeasuredProcess, CountsTheLargestOfItsProcesses) {
  const double small = run("true").peak_megabytes;
  const double large = run("dd if=/dev/zero of=/dev/null bs=200M count=1 2>/dev/null; true").peak_megabytes;
  EXPECT_GT(large, 199);
  EXPECT_LT(large, 260);
  EXPECT_LT(small, 150);
}

TEST_F(MeasuredProcess, RefusesAProgramThatIsNotThere) {
  EXPECT_THROW(run_measured({folder_.path() / "none"}, {}, log_), std::runtime_error);
  EXPECT_TRUE(find_program("no-such-program-of-saltus").empty());
  EXPECT_EQ(find_program("sh").filename(), "sh");
}

}  // namespace
}  // namespace saltus::benchmark
