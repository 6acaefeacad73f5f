
#include "client/cli/closest_word.h"
#include "client/cli/command.h"
#include "tests/support/captured_command_line.h"

#include <gmock/gmock.h>

#include <cstdlib>
#include <vector>

namespace saltus::cli {
namespace {

using testing::HasSubstr;

using Outcome = testing_support::CapturedRun;

Outcome run(const std::vector<std::string>& words) { return testing_support::run_command_line_captured(words); }

class CommandLine : public testing::Test {
 protected:
  void SetUp() override { unsetenv("SALTUS_SERVER"); }
};

TEST_F(CommandLine, HelpsEverywhere) {
  EXPECT_THAT(run({"--help"}).out, HasSubstr("register"));
  for (const char* command : {"register", "submit", "watch", "list", "get", "fetch", "cancel", "delete"}) {
    const Outcome outcome = run({command, "--help"});
    EXPECT_EQ(outcome.exit_code, Done) << command;
    EXPECT_THAT(outcome.out, HasSubstr("Example")) << command;
    EXPECT_THAT(outcome.out, HasSubstr("--json")) << command;
    EXPECT_THAT(outcome.out, HasSubstr("--server")) << command;
  }
}

TEST_F(CommandLine, SaysHowFilesAreNamed) {
  const Outcome outcome = run({"register", "exhale.nii.gz", "inhale.nii.gz"});
  EXPECT_EQ(outcome.exit_code, Usage);
  EXPECT_THAT(outcome.err, HasSubstr("--fixed A --moving B --out DIR"));
}

TEST_F(CommandLine, HelpsAdministrators) {
  for (const char* command : {"info", "drain", "gc", "fsck"}) {
    const Outcome outcome = run({"server", command, "--help"});
    EXPECT_EQ(outcome.exit_code, Done) << command;
    EXPECT_THAT(outcome.out, HasSubstr("Example")) << command;
    EXPECT_THAT(outcome.out, HasSubstr("--json")) << command;
    EXPECT_EQ(run({"server", command}).exit_code, Usage) << command;
  }
  EXPECT_EQ(run({"server"}).exit_code, Usage);
  EXPECT_EQ(run({"server", "drain", "--wait", "--resume", "--server", "unix:/nowhere/socket"}).exit_code, Usage);
  EXPECT_EQ(run({"server", "drain", "--server", "unix:/nowhere/socket"}).exit_code, ServerNotReachable);
}

TEST_F(CommandLine, RefusesWhatItDoesNotKnow) {
  EXPECT_EQ(run({}).exit_code, Usage);
  EXPECT_EQ(run({"regsiter"}).exit_code, Usage);
  EXPECT_EQ(run({"get"}).exit_code, Usage);
  EXPECT_EQ(run({"get", "id", "--jsn"}).exit_code, Usage);
}

TEST_F(CommandLine, SaysWhatWasMeant) {
  EXPECT_THAT(run({"regsiter"}).err, HasSubstr("Did you mean register?"));
  const std::string text = run({"register", "--fixd", "a.mha", "--modle=sliding"}).err;
  EXPECT_THAT(text, testing::AllOf(testing::StartsWith("saltus: "), HasSubstr("Did you mean --fixed?"),
                                   HasSubstr("Did you mean --model?"), HasSubstr("saltus register --help")));
  EXPECT_THAT(run({"register", "--nonsense", "1"}).err, testing::Not(HasSubstr("Did you mean")));
  EXPECT_THAT(run({"server", "inof"}).err, HasSubstr("Did you mean info?"));
  EXPECT_EQ(closest_word("--out", {"--in", "--out"}), "--out");
  EXPECT_EQ(closest_word("-x", {"--in", "--out"}), "");
}

TEST_F(CommandLine, AsksForAServerWhereItNeedsOne) {
  const Outcome outcome = run({"get", "id"});
  EXPECT_EQ(outcome.exit_code, Usage);
  EXPECT_THAT(outcome.err, HasSubstr("SALTUS_SERVER"));
  EXPECT_THAT(run({"get", "id", "--server", "nonsense"}).err, HasSubstr("nonsense"));
}

TEST_F(CommandLine, TakesTheServerFromTheEnvironment) {
  setenv("SALTUS_SERVER", "nonsense", 1);
  EXPECT_THAT(run({"get", "id"}).err, HasSubstr("nonsense"));
}

TEST_F(CommandLine, SendsNothingInTheClearBeyondThisMachine) {
  for (const char* server : {"registry.hospital.example:7443", "10.0.0.7:7443", "[2001:db8::1]:7443"}) {
    const Outcome outcome = run({"get", "id", "--server", server});
    EXPECT_EQ(outcome.exit_code, Usage);
    EXPECT_THAT(outcome.err, HasSubstr("in the clear"));
  }
  const Outcome half =
      run({"get", "id", "--server", "10.0.0.7:7443", "--tls-ca", "/nowhere", "--tls-cert", "/nowhere"});
  EXPECT_EQ(half.exit_code, Usage);
  EXPECT_THAT(half.err, HasSubstr("--tls-key is not given"));
  const Outcome unreadable = run({"get", "id", "--server", "10.0.0.7:7443", "--tls-ca", "/nowhere", "--tls-cert",
                                  "/nowhere", "--tls-key", "/nowhere"});
  EXPECT_EQ(unreadable.exit_code, Usage);
  EXPECT_THAT(unreadable.err, HasSubstr("--tls-ca is /nowhere, which cannot be read"));
}

TEST_F(CommandLine, NamesAFileThatIsNotThere) {
  const Outcome outcome = run({"register", "--fixed", "/nowhere.mha", "--moving", "/nowhere.mha", "--out", "x"});
  EXPECT_EQ(outcome.exit_code, Usage);
  EXPECT_THAT(outcome.err, HasSubstr("/nowhere.mha"));
}

TEST_F(CommandLine, ListsTheParametersWithoutImages) {
  const Outcome outcome = run({"register", "--model", "wendland1", "--set", "help"});
  EXPECT_EQ(outcome.exit_code, Done);
  EXPECT_THAT(outcome.out, HasSubstr("time_steps"));
  EXPECT_EQ(run({"register", "--model", "demons", "--set", "help"}).exit_code, Usage);
}

}  // namespace
}  // namespace saltus::cli
