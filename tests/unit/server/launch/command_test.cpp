#include "server/launch/command.h"

#include "tests/support/temporary_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <sstream>
#include <stop_token>
#include <string>

namespace saltus::server {
namespace {

using namespace std::chrono_literals;
using ::testing::HasSubstr;
using testing_support::content_of;

TEST(RunCommand, GivesInputAndTakesOutputAndErrors) {
  const auto result = run_command({{"sh", "-c", "cat; echo bad >&2; exit 3"}, std::string(1 << 20, 'x')}, 60s);
  EXPECT_EQ(result.end, CommandResult::End::Exited);
  EXPECT_EQ(result.code, 3);
  EXPECT_EQ(result.output, std::string(1 << 20, 'x'));
  EXPECT_EQ(describe(result), "bad");
}

TEST(RunCommand, OneThatDoesNotReadItsInputIsNoError) {
  EXPECT_TRUE(run_command({{"true"}, std::string(1 << 22, 'x')}, 60s).is_good());
}

TEST(RunCommand, OneThatTakesTooLongGoesWithAllThatItHasStarted) {
  const auto result = run_command({{"sh", "-c", "sleep 1000 & echo $!; wait"}, ""}, 200ms);
  EXPECT_EQ(result.end, CommandResult::End::TimedOut);
  const int child = std::stoi(result.output);
  // Killed, and at most waiting to be reaped by whoever inherits it.
  std::string state;
  for (int i = 0; i < 100000; ++i) {
    std::istringstream stat(content_of("/proc/" + std::to_string(child) + "/stat"));
    std::string skipped;
    state.clear();
    stat >> skipped >> skipped >> state;
    if (state.empty() || state == "Z" || state == "X") break;
  }
  EXPECT_TRUE(state.empty() || state == "Z" || state == "X") << state;
}

TEST(RunCommand, OneThatLeavesSomebodyWithItsOutputHasEnded) {
  const auto result = run_command({{"sh", "-c", "sleep 1000 & echo done"}, ""}, 60s);
  EXPECT_TRUE(result.is_good());
  EXPECT_EQ(result.output, "done\n");
}

TEST(RunCommand, IsStoppedWithItsDaemon) {
  std::stop_source stop;
  stop.request_stop();
  EXPECT_EQ(run_command({{"sleep", "1000"}, ""}, 60s, stop.get_token()).end, CommandResult::End::Stopped);
}

TEST(RunCommand, AProgramThatIsNotThereIsToldSo) {
  const auto result = run_command({{"no-such-program-anywhere"}, ""}, 60s);
  EXPECT_EQ(result.end, CommandResult::End::NotStarted);
  EXPECT_THAT(describe(result), HasSubstr("No such file"));
}

}  // namespace
}  // namespace saltus::server
