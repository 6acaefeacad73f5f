// What comes in between: terminals and readers that go, full disks, results that are there already.
#include "tests/end_to_end/end_to_end.h"

#include <algorithm>
#include <csignal>
#include <fstream>
#include <iterator>
#include <set>

namespace saltus {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing::HasSubstr;
using testing_support::blob_scene;
using testing_support::ChildProcess;
using testing_support::content_of;
using testing_support::EndToEnd;
using testing_support::Outcome;
using testing_support::ProcessHandle;
using testing_support::programs;
using testing_support::ServerTest;
using testing_support::shift_mm;

/// `saltus ARGUMENTS...` as "$@" of a script, which has `name` as $0.
std::vector<std::string> in_shell(const std::string& script, const std::vector<std::string>& arguments,
                                  const std::string& name = "sh") {
  std::vector<std::string> command{"/bin/sh", "-c", script, name, programs + "/saltus"};
  command.insert(command.end(), arguments.begin(), arguments.end());
  return command;
}

template <class Test>
class Disturbed : public Test {
 protected:
  Outcome run_in_shell(const std::string& script, const std::vector<std::string>& arguments) const {
    ChildProcess child(in_shell(script, arguments), this->environment());
    const int exit_code = child.wait();
    return {exit_code, child.out(), child.err()};
  }
  /// Where standard output takes nothing.
  Outcome run_on_full_disk(const std::vector<std::string>& arguments) const {
    return run_in_shell("exec \"$@\" > /dev/full", arguments);
  }
  std::vector<std::string> job_in_format(const std::string& format, const std::vector<std::string>& command) const {
    std::vector<std::string> words = this->job(command, Test::of_a_moment());
    *std::next(std::find(words.begin(), words.end(), "--format")) = format;
    return words;
  }
  /// Names of the files in a folder that end so.
  static std::set<std::string> files_of(const fs::path& folder, const std::string& suffix) {
    std::set<std::string> names;
    for (const auto& file : fs::directory_iterator(folder))
      if (const std::string name = file.path().filename().string(); name.ends_with(suffix)) names.insert(name);
    return names;
  }
};

using DisturbedCommand = Disturbed<EndToEnd>;
using DisturbedClient = Disturbed<ServerTest>;

TEST_F(DisturbedCommand, ALostTerminalCancelsTheJobAndLeavesNothingBehind) {
  // These tests themselves may run where hang-ups are ignored, which children inherit.
  const auto former = std::signal(SIGHUP, SIG_DFL);
  ChildProcess child = start(job({"register", "--out", folder / "out"}, of_minutes()));
  std::signal(SIGHUP, former);
  child.wait_for_output("iteration");
  child.signal(SIGHUP);
  EXPECT_EQ(child.wait(), 4);
  EXPECT_THAT(child.err(), HasSubstr("was cancelled"));
  EXPECT_TRUE(fs::is_empty(folder / "tmp"));
  EXPECT_FALSE(fs::exists(folder / "out"));
}

TEST_F(DisturbedCommand, UnderNohupAJobOutlivesItsTerminal) {
  ChildProcess child(
      in_shell("trap '' HUP; exec \"$@\"", job({"register", "--out", folder / "out"}, of_some_seconds())),
      environment());
  child.wait_for_output("iteration");
  child.signal(SIGHUP);
  EXPECT_EQ(child.wait(), 0) << child.err();
  EXPECT_TRUE(fs::exists(folder / "out" / "report.json"));
}

// `saltus register ... 2>&1 | head -1`: there is more to tell than one line.
TEST_F(DisturbedCommand, WhoseReaderGoesDoesItsWorkAndLeavesNothingBehind) {
  ChildProcess child(in_shell("{ \"$@\" 2>&1; echo $? > \"$0\"; } | head -1",
                              job({"register", "--out", folder / "out"}, of_some_seconds()), folder / "code"),
                     environment());
  EXPECT_EQ(child.wait(), 0);
  EXPECT_EQ(std::count(child.out().begin(), child.out().end(), '\n'), 1) << child.out();
  EXPECT_EQ(content_of(folder / "code"), "1\n") << "its summary has reached nobody";
  EXPECT_TRUE(fs::exists(folder / "out" / "report.json"));
  EXPECT_TRUE(fs::is_empty(folder / "tmp"));
}

TEST_F(DisturbedCommand, WhatAKilledOneLeavesIsRemovedByTheNext) {
  // One has to outlive two others.
  write_volume(folder / "fixed.mha", blob_scene(128, 0));
  write_volume(folder / "moving.mha", blob_scene(128, shift_mm));
  ChildProcess living = start(job({"register", "--out", folder / "living"}, of_minutes()));
  living.wait_for_output("iteration");
  ChildProcess killed = start(job({"register", "--out", folder / "killed"}, of_minutes()));
  killed.wait_for_output("iteration");
  const auto daemons = killed.children();
  ASSERT_EQ(daemons.size(), 1u);
  const ProcessHandle daemon(daemons[0]);
  killed.signal(SIGKILL);
  EXPECT_EQ(killed.wait(), 128 + SIGKILL);
  ASSERT_TRUE(daemon.ends_within(std::chrono::seconds(60)));
  EXPECT_EQ(files_of(folder / "tmp", "").size(), 2u);

  const Outcome next = run(job({"register", "--out", folder / "next"}, of_a_moment()));
  EXPECT_EQ(next.exit_code, 0) << next.err;
  EXPECT_EQ(files_of(folder / "tmp", "").size(), 1u) << "the folder of the one that lives";
  living.signal(SIGINT);
  EXPECT_EQ(living.wait(), 4) << living.err();
  EXPECT_TRUE(fs::is_empty(folder / "tmp"));
}

TEST_F(DisturbedCommand, SaysThatItsOutputIsLost) {
  for (const std::vector<std::string>& words : {std::vector<std::string>{"--help"},
                                                {"--version"},
                                                {"register", "--help"},
                                                {"register", "--set", "help"},
                                                {"man"},
                                                {"completion", "bash"}}) {
    const Outcome outcome = run_on_full_disk(words);
    EXPECT_EQ(outcome.exit_code, 1) << words.back();
    EXPECT_THAT(outcome.err, testing::StartsWith("saltus: standard output cannot be written")) << words.back();
    EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
  }
}

TEST_F(DisturbedCommand, KeepsItsResultWhereItsOutputIsLost) {
  const Outcome outcome = run_on_full_disk(job({"register", "--json", "--out", folder / "out"}, of_a_moment()));
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_THAT(outcome.err, HasSubstr("saltus: standard output cannot be written"));
  expect_shift(folder / "out" / "displacement.mha");
  EXPECT_TRUE(fs::is_empty(folder / "tmp"));
}

// What is closed is opened by nobody else: not by a pipe that a progress bar would then be written to.
TEST_F(DisturbedCommand, DoesItsWorkWhereNothingIsOpen) {
  const Outcome outcome =
      run_in_shell("exec \"$@\" <&- >&- 2>&-", job({"register", "--out", folder / "out"}, of_a_moment()));
  EXPECT_EQ(outcome.exit_code, 1) << "its summary has reached nobody";
  expect_shift(folder / "out" / "displacement.mha");
  EXPECT_TRUE(fs::is_empty(folder / "tmp"));
}

// The images fit into files of so many blocks of 512 bytes, the displacement does not: no signal ends the worker.
TEST_F(DisturbedCommand, SaysWhichResultMayNotBeSoLarge) {
  write_volume(folder / "fixed.mha", blob_scene(512, 0));
  write_volume(folder / "moving.mha", blob_scene(512, shift_mm));
  const Outcome outcome =
      run_in_shell("ulimit -f 3000; exec \"$@\"", job({"register", "--out", folder / "out"}, of_a_moment()));
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_THAT(outcome.err, HasSubstr("cannot write displacement.mha: File too large"));
  EXPECT_TRUE(fs::is_empty(folder / "tmp"));
}

TEST_F(DisturbedCommand, DoesNotReplaceItsInput) {
  ASSERT_EQ(run(job({"register", "--out", folder / "out"}, of_a_moment())).exit_code, 0);
  std::vector<std::string> command = job({"register", "--out", folder / "out"}, of_a_moment());
  *std::next(std::find(command.begin(), command.end(), "--moving")) = folder / "out" / "warped.mha";
  const Outcome outcome = run(command);
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_THAT(outcome.err, HasSubstr("which lies in --out under the name of a result"));
  EXPECT_TRUE(fs::exists(folder / "out" / "warped.mha"));
}

TEST_F(DisturbedCommand, LeavesNoPartsOfFilesThatAreTooLarge) {
  const Outcome outcome =
      run_in_shell("ulimit -f 8; exec \"$@\"", {"phantom", "slip", "--size", "256,256", "--out", folder / "scene"});
  EXPECT_EQ(outcome.exit_code, 1) << outcome.err;
  EXPECT_THAT(outcome.err, HasSubstr("saltus: cannot write "));
  for (const std::string& name : files_of(folder / "scene", "")) EXPECT_FALSE(name.starts_with(".")) << name;
}

TEST_F(DisturbedCommand, AResultInAnotherFormatTakesThePlaceOfTheOld) {
  const fs::path out = folder / "out";
  fs::create_directory(out);
  std::ofstream(out / "jacobian.nrrd") << "of somebody who has no result here yet";
  ASSERT_EQ(run(job_in_format("mha", {"register", "--out", out})).exit_code, 0);
  EXPECT_TRUE(fs::exists(out / "jacobian.nrrd"));
  const std::set<std::string> old = files_of(out, ".mha");
  EXPECT_TRUE(old.contains("displacement.mha") && old.contains("momentum_1_order0.mha"));
  // As of more scales; and what is the user's own.
  fs::copy_file(out / "momentum_1_order0.mha", out / "momentum_9_order1_x.mha");
  fs::copy_file(out / "warped.mha", out / "warped_before.mha");
  std::ofstream(out / "notes.mha") << "no image";

  ASSERT_EQ(run(job_in_format("nrrd", {"register", "--out", out})).exit_code, 0);
  EXPECT_EQ(files_of(out, ".mha"), (std::set<std::string>{"notes.mha", "warped_before.mha"}));
  std::set<std::string> expected;
  for (const std::string& name : old) expected.insert(name.substr(0, name.size() - 4) + ".nrrd");
  EXPECT_EQ(files_of(out, ".nrrd"), expected);
  const fs::path points = folder.write("points.csv", "x,y\n16,71\n");
  const Outcome carried = run({"points", "--transform", out, "--in", points, "--out", folder / "carried.csv"});
  EXPECT_EQ(carried.exit_code, 0) << carried.err;
}

TEST_F(DisturbedClient, AFetchedResultInAnotherFormatTakesThePlaceOfTheOld) {
  const fs::path out = folder / "out";
  for (const std::string format : {"nii.gz", "mha"}) {
    const Outcome submitted = run(here(job_in_format(format, {"submit"})));
    ASSERT_EQ(submitted.exit_code, 0) << submitted.err;
    const std::string id = submitted.out.substr(0, submitted.out.find('\n'));
    ASSERT_EQ(run(here({"watch", id})).exit_code, 0);
    ASSERT_EQ(run(here({"fetch", id, "--out", out})).exit_code, 0);
    EXPECT_TRUE(fs::exists(out / ("displacement." + format)));
  }
  EXPECT_TRUE(files_of(out, ".nii.gz").empty());
}

TEST_F(DisturbedClient, SaysThatItsOutputIsLost) {
  const Outcome listed = run_on_full_disk(here({"list"}));
  EXPECT_EQ(listed.exit_code, 1);
  EXPECT_THAT(listed.err, testing::StartsWith("saltus: standard output cannot be written"));
}

TEST_F(DisturbedClient, TellsTheIdOfItsJobWhereItsOutputIsLost) {
  for (const std::vector<std::string>& command : {std::vector<std::string>{"submit"}, {"submit", "--json"}}) {
    const Outcome submitted = run_on_full_disk(here(job(command, of_a_moment())));
    EXPECT_EQ(submitted.exit_code, 1);
    const std::string id = json::parse(run(here({"list", "--json", "--limit", "1"})).out).at(0).at("id");
    EXPECT_THAT(submitted.err, HasSubstr("standard output cannot be written"));
    EXPECT_THAT(submitted.err, HasSubstr(id));
    EXPECT_EQ(std::count(submitted.err.begin(), submitted.err.end(), '\n'), 1) << submitted.err;
  }
}

TEST_F(DisturbedClient, DoesNotWatchOnForNobody) {
  const std::string id = submit(of_minutes());
  const Outcome watched = run_on_full_disk(here({"watch", id, "--json"}));
  EXPECT_EQ(watched.exit_code, 1);
  EXPECT_THAT(watched.err, HasSubstr("job " + id + " is not watched any more"));
  EXPECT_EQ(run(here({"cancel", id})).exit_code, 0);
}

}  // namespace
}  // namespace saltus
