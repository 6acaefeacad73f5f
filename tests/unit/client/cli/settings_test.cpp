// Options that come from a file or the environment, and what shells and manuals are told about options.
#include "client/cli/command.h"
#include "tests/support/captured_command_line.h"
#include "tests/support/child_process.h"
#include "tests/support/temporary_folder.h"

#include <gmock/gmock.h>

#include <cstdlib>
#include <filesystem>
#include <sstream>

namespace saltus::cli {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
using testing_support::ChildProcess;

using Outcome = testing_support::CapturedRun;

class Settings : public testing::Test {
 protected:
  ~Settings() override {
    for (const std::string& name : set_) unsetenv(name.c_str());
  }
  void set(const std::string& name, const std::string& value) {
    setenv(name.c_str(), value.c_str(), 1);
    set_.push_back(name);
  }
  Outcome run(const std::vector<std::string>& words) { return testing_support::run_command_line_captured(words); }
  /// Of the parameters that --set help lists, which depend on model, similarity and preset.
  std::string first_order_scales(std::vector<std::string> words) {
    words.insert(words.end(), {"--set", "help"});
    const std::string table = run(words).out;
    std::istringstream line(table.substr(table.find("first_order_scales")));
    std::string name, value;
    line >> name >> value;
    return value;
  }

  testing_support::TemporaryFolder folder;
  std::vector<std::string> set_;
};

std::string program(const std::string& name) {
  std::istringstream folders(std::getenv("PATH"));
  for (std::string folder; std::getline(folders, folder, ':');)
    if (std::filesystem::exists(folder + "/" + name)) return folder + "/" + name;
  return "";
}

// Oracle: the default of sliding, lncc is 1, of gaussian 0, of wendland1 8.
TEST_F(Settings, ComeFromTheEnvironmentForTheCommandThatRuns) {
  EXPECT_EQ(first_order_scales({"register"}), "1");
  set("SALTUS_MODEL", "gaussian");
  EXPECT_EQ(first_order_scales({"register"}), "0");
  EXPECT_EQ(first_order_scales({"register", "--model", "wendland1"}), "8");
  // What is meant for one command does not touch another.
  set("SALTUS_FIXED", "/nowhere.mha");
  EXPECT_EQ(run({"phantom", "slip", "--size", "32,32", "--out", folder / "p"}).exit_code, Done);
  EXPECT_EQ(run({"register", "--out", folder / "r"}).exit_code, Usage);
}

TEST_F(Settings, ComeFromAFile) {
  const std::string file = folder.write("saltus.toml", "[register]\nmodel = \"gaussian\"\n");
  EXPECT_EQ(first_order_scales({"register", "--config", file}), "0");
  EXPECT_EQ(first_order_scales({"--config", file, "register"}), "0");
  EXPECT_EQ(first_order_scales({"register", "--config", file, "--model", "wendland1"}), "8");
  set("SALTUS_CONFIG", file);
  EXPECT_EQ(first_order_scales({"register"}), "0");
}

TEST_F(Settings, ComeFromTheCommandLineBeforeTheEnvironmentBeforeAFile) {
  const std::string file = folder.write(
      "saltus.toml", "[register]\nmodel = \"gaussian\"\nset = [\"help\"]\n[submit]\nmodel = \"gaussian\"\n");
  set("SALTUS_CONFIG", file);
  EXPECT_EQ(first_order_scales({"register"}), "0");
  set("SALTUS_MODEL", "wendland1");
  EXPECT_EQ(first_order_scales({"register"}), "8");
  EXPECT_EQ(first_order_scales({"register", "--model", "sliding"}), "1");
  // What the environment leaves open still comes from the file: here that --set help is asked for.
  EXPECT_THAT(run({"register"}).out, HasSubstr("first_order_scales"));
  // A variable that is set to nothing says nothing.
  set("SALTUS_MODEL", "");
  EXPECT_EQ(first_order_scales({"register"}), "0");
}

// Whoever has a number of jobs for all lists still registers single pairs.
TEST_F(Settings, JobsOfTheEnvironmentOrAFileAreForListsAlone) {
  const std::vector<std::string> pair{"register", "--fixed", folder.write("a.mha", "x"), "--moving",
                                      folder.write("b.mha", "x")};
  // Complete but for --out, so that nothing is begun.
  const auto complaint = [&](std::vector<std::string> more) {
    more.insert(more.begin(), pair.begin(), pair.end());
    const Outcome outcome = run(more);
    EXPECT_EQ(outcome.exit_code, Usage);
    return outcome.err;
  };
  set("SALTUS_JOBS", "2");
  EXPECT_THAT(complaint({}), HasSubstr("--out is missing"));
  EXPECT_THAT(complaint({"--jobs", "2"}), HasSubstr("--jobs is given without --pairs"));
  EXPECT_THAT(complaint({"--jobs=3"}), HasSubstr("--jobs is given without --pairs"));
  set("SALTUS_JOBS", "");
  EXPECT_THAT(complaint({"--config", folder.write("saltus.toml", "[register]\njobs = 2\n")}),
              HasSubstr("--out is missing"));
  // For a list it counts: what cannot be is refused.
  set("SALTUS_JOBS", "many");
  EXPECT_THAT(complaint({}), HasSubstr("many"));
}

TEST_F(Settings, OfNestedCommandsComeInTheSameOrder) {
  const std::string file = folder.write("saltus.toml", "[server.info]\nserver = \"of the file\"\n");
  EXPECT_THAT(run({"--config", file, "server", "info"}).err, HasSubstr("of the file"));
  set("SALTUS_SERVER", "of the environment");
  EXPECT_THAT(run({"--config", file, "server", "info"}).err, HasSubstr("of the environment"));
  EXPECT_THAT(run({"--config", file, "server", "info", "--server", "of the line"}).err, HasSubstr("of the line"));
}

TEST_F(Settings, RefuseAFileThatIsNotThereOrHasWhatNobodyKnows) {
  EXPECT_EQ(run({"register", "--config", folder / "no.toml", "--set", "help"}).exit_code, Usage);
  const std::string unknown = folder.write("saltus.toml", "[register]\nmodle = \"gaussian\"\n");
  const Outcome outcome = run({"register", "--config", unknown, "--set", "help"});
  EXPECT_EQ(outcome.exit_code, Usage);
  EXPECT_THAT(outcome.err, HasSubstr("modle"));
  set("SALTUS_CONFIG", folder / "no.toml");
  EXPECT_THAT(run({"register", "--set", "help"}).err, HasSubstr("SALTUS_CONFIG is"));
}

TEST_F(Settings, EveryCommandKnowsJson) {
  for (const char* command : {"register", "submit", "watch", "list", "get", "fetch", "cancel", "delete", "points",
                              "warp", "evaluate", "phantom"})
    EXPECT_THAT(run({command, "--help"}).out, AllOf(HasSubstr("--json"), HasSubstr("Example"))) << command;
}

/// What bash offers after these words, the last of them unfinished.
std::string offered(const std::string& script, const std::string& words) {
  std::istringstream all(words + "x");
  int last = -1;
  for (std::string word; all >> word;) ++last;
  ChildProcess bash({program("bash"), "--norc", "-c",
                     "compopt() { :; }; source '" + script + "'; COMP_WORDS=(" + words +
                         (words.ends_with(' ') ? "''" : "") + "); COMP_CWORD=" + std::to_string(last) +
                         "; _saltus; printf '%s\\n' \"${COMPREPLY[@]}\""});
  EXPECT_EQ(bash.wait(), 0) << bash.err();
  EXPECT_EQ(bash.err(), "");
  return "\n" + bash.out();
}

TEST_F(Settings, AreCompletedByBash) {
  const std::string script = folder.write("saltus.bash", run({"completion", "bash"}).out);
  EXPECT_EQ(offered(script, "saltus reg"), "\nregister\n");
  EXPECT_THAT(offered(script, "saltus "), AllOf(HasSubstr("\nphantom\n"), HasSubstr("\nserver\n")));
  EXPECT_EQ(offered(script, "saltus register --points-sp"), "\n--points-space\n");
  EXPECT_EQ(offered(script, "saltus register --model wend"), "\nwendland\nwendland1\n");
  EXPECT_EQ(offered(script, "saltus register --preset "), "\nfast\nbalanced\naccurate\n");
  EXPECT_THAT(offered(script, "saltus server "), AllOf(HasSubstr("\ninfo\n"), HasSubstr("\nfsck\n")));
  EXPECT_THAT(offered(script, "saltus server drain --"), AllOf(HasSubstr("\n--wait\n"), Not(HasSubstr("--model"))));
  EXPECT_EQ(offered(script, "saltus register --json --points-sp"), "\n--points-space\n");  // a flag takes no value
  EXPECT_EQ(offered(script, "saltus register --js"), "\n--json\n");
  EXPECT_EQ(offered(script, "saltus register --json --mod"), "\n--model\n");
  EXPECT_THAT(offered(script, "saltus register --json "), HasSubstr("\n--model\n"));
  EXPECT_EQ(offered(script, "saltus phantom rec"), "\nrectangle\n");
  EXPECT_EQ(offered(script, "saltus completion z"), "\nzsh\n");
  folder.write("fixed_of_the_test.mha", "");
  EXPECT_EQ(offered(script, "saltus register --fixed " + (folder / "fixed_of").string()),
            "\n" + (folder / "fixed_of_the_test.mha").string() + "\n");
}

TEST_F(Settings, AreWrittenForOtherShellsInTheirGrammar) {
  const std::string zsh = run({"completion", "zsh"}).out, fish = run({"completion", "fish"}).out;
  EXPECT_THAT(zsh,
              AllOf(HasSubstr("#compdef saltus"), HasSubstr("(gaussian wendland wendland1 directional sliding auto)"),
                    HasSubstr("*--json[Print job and report as JSON]'"), HasSubstr("'study:The paper'\\''s figures")));
  EXPECT_THAT(fish, HasSubstr("-l preset -x -a 'fast balanced accurate'"));
  EXPECT_EQ(run({"completion", "csh"}).exit_code, Usage);
}

TEST_F(Settings, AreCompletedByFish) {
  if (program("fish").empty()) GTEST_SKIP() << "there is no fish on this machine";
  const std::string script = folder.write("saltus.fish", run({"completion", "fish"}).out);
  const auto offered_by_fish = [&](const std::string& words) {
    ChildProcess fish({program("fish"), "--no-config", "-c", "source '" + script + "'; complete -C '" + words + "'"});
    EXPECT_EQ(fish.wait(), 0) << fish.err();
    EXPECT_EQ(fish.err(), "");
    return "\n" + fish.out();
  };
  EXPECT_THAT(offered_by_fish("saltus reg"), HasSubstr("\nregister\t"));
  EXPECT_THAT(offered_by_fish("saltus register --preset "), AllOf(HasSubstr("fast"), HasSubstr("accurate")));
  EXPECT_THAT(offered_by_fish("saltus register --points-sp"), HasSubstr("--points-space"));
  EXPECT_THAT(offered_by_fish("saltus phantom "), AllOf(HasSubstr("rectangle"), HasSubstr("smooth")));
  EXPECT_THAT(offered_by_fish("saltus register --json --mod"), HasSubstr("--model"));
  EXPECT_THAT(offered_by_fish("saltus stu"), HasSubstr("study\tThe paper"));
  EXPECT_THAT(offered_by_fish("saltus study "), AllOf(HasSubstr("paper"), HasSubstr("liver")));
}

TEST_F(Settings, AreCompletedByZsh) {
  if (program("zsh").empty()) GTEST_SKIP() << "there is no zsh on this machine";
  folder.write("_saltus", run({"completion", "zsh"}).out);
  // Completion belongs to the line editor, so one zsh types into the terminal of another, and reads until it has seen
  // what must come.
  const std::string script =
      "zmodload zsh/zpty; zpty inner zsh -f -i\n"
      "zpty -w inner \"PS1=; fpath=('" +
      folder.path().string() +
      "' \\$fpath); autoload -Uz compinit; compinit -u -D; print ready-\\$((1+1))\"\n"
      "zpty -r -m inner all '*ready-2*'\n"
      "zpty -n -w inner 'saltus reg'$'\\t'; zpty -r -m inner all '*saltus reg*ister*' || exit 1\n"
      "zpty -n -w inner $'\\x15''saltus register --preset acc'$'\\t'; zpty -r -m inner all '*preset acc*urate*' || "
      "exit 2\n"
      "zpty -n -w inner $'\\x15''saltus register --json --pres'$'\\t'; "
      "zpty -r -m inner all '*json --pres*et*' || exit 3\n"
      "zpty -n -w inner $'\\x15''saltus phantom rec'$'\\t'; zpty -r -m inner all '*phantom rec*tangle*' || exit 4\n"
      "zpty -d inner\n";
  ChildProcess zsh({program("timeout"), "60", program("zsh"), "-f", folder.write("typed.zsh", script)});
  EXPECT_EQ(zsh.wait(), 0) << zsh.err();
}

TEST_F(Settings, StandInTheManual) {
  const std::string page = run({"man"}).out;
  EXPECT_THAT(page,
              AllOf(HasSubstr(".SS saltus register"), HasSubstr("\\-\\-points\\-space"), HasSubstr("EXIT STATUS")));
  if (program("groff").empty()) GTEST_SKIP() << "there is no groff on this machine that could set the page";
  ChildProcess groff({program("groff"), "-man", "-Tascii", "-P-cbou", "-ww", folder.write("saltus.1", page)});
  EXPECT_EQ(groff.wait(), 0);
  EXPECT_EQ(groff.err(), "");
  EXPECT_THAT(groff.out(), HasSubstr("EXIT STATUS"));
}

}  // namespace
}  // namespace saltus::cli
