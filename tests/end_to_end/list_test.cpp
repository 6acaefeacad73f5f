// Lists of pairs, with the programs as a user has them.
#include "core/support/available_cores.h"
#include "tests/end_to_end/end_to_end.h"

#include <algorithm>
#include <csignal>
#include <iterator>

namespace saltus {
namespace {

using nlohmann::json;
using testing::HasSubstr;
using testing_support::blob_scene;
using testing_support::ChildProcess;
using testing_support::content_of;
using testing_support::EndToEnd;
using testing_support::Outcome;
using testing_support::programs;

class ListOfPairs : public EndToEnd {
 protected:
  void SetUp() override {
    EndToEnd::SetUp();
    folder.write("pairs.csv", "name,fixed,moving\none,fixed.mha,moving.mha\ntwo,moving.mha,fixed.mha\n");
  }
  std::vector<std::string> list(const std::vector<std::string>& more = of_a_moment()) const {
    std::vector<std::string> command{"register", "--pairs", folder / "pairs.csv", "--out", folder / "out",
                                     "--format", "mha",     "--preset",           "fast",  "--threads",
                                     "1"};
    command.insert(command.end(), more.begin(), more.end());
    return command;
  }
};

TEST_F(ListOfPairs, IsRegisteredOneAfterTheOtherAndNotTwice) {
  auto one_by_one = list();
  one_by_one.insert(one_by_one.end(), {"--jobs", "1"});
  const Outcome first = run(one_by_one);
  ASSERT_EQ(first.exit_code, 0) << first.err;
  EXPECT_THAT(first.err, HasSubstr("pair 2 of 2"));
  EXPECT_THAT(first.out, HasSubstr("2 of 2 pairs done"));
  expect_shift(folder / "out" / "one" / "displacement.mha");
  const std::string summary = content_of(folder / "out" / "summary.csv");
  EXPECT_THAT(summary, HasSubstr("\none,done,"));
  EXPECT_THAT(summary, HasSubstr("\ntwo,done,"));
  EXPECT_TRUE(std::filesystem::is_empty(folder / "tmp"));

  const auto made = std::filesystem::last_write_time(folder / "out" / "one" / "displacement.mha");
  const Outcome again = run(list());
  EXPECT_EQ(again.exit_code, 0) << again.err;
  EXPECT_THAT(again.err, HasSubstr("2 of 2 pairs are done already"));
  EXPECT_EQ(std::filesystem::last_write_time(folder / "out" / "one" / "displacement.mha"), made);

  // Another result must not take the place of the first by mistake.
  auto other = of_a_moment();
  other.insert(other.end(), {"--set", "time_steps=5"});
  const Outcome refused = run(list(other));
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.err, HasSubstr("the result of other files or options"));
}

// What another command has written to a pair's folder is not the list's.
TEST_F(ListOfPairs, IsDoneAgainWhereAnotherResultHasTakenItsPlace) {
  ASSERT_EQ(run(list()).exit_code, 0);
  ASSERT_EQ(
      run(job({"register", "--out", folder / "out" / "one"}, {"--model", "gaussian", "--similarity", "ncc"})).exit_code,
      0);
  const Outcome again = run(list());
  EXPECT_EQ(again.exit_code, 0) << again.err;
  EXPECT_THAT(again.err, HasSubstr("1 of 2 pairs are done already"));
  EXPECT_EQ(json::parse(content_of(folder / "out" / "one" / "report.json"))["similarity"], "ssd");
}

TEST_F(ListOfPairs, GoesOnAfterAnInterruption) {
  auto one_by_one = list(of_some_seconds());
  one_by_one.insert(one_by_one.end(), {"--jobs", "1"});
  ChildProcess child = start(one_by_one);
  child.wait_for_output("pair 2 of 2");
  child.signal(SIGINT);
  EXPECT_EQ(child.wait(), 4) << child.err();
  EXPECT_TRUE(std::filesystem::exists(folder / "out" / "one" / "report.json"));
  EXPECT_FALSE(std::filesystem::exists(folder / "out" / "two"));
  EXPECT_TRUE(std::filesystem::is_empty(folder / "tmp"));

  const Outcome rest = run(list(of_some_seconds()));
  EXPECT_EQ(rest.exit_code, 0) << rest.err;
  EXPECT_THAT(rest.err, HasSubstr("1 of 2 pairs are done already"));
  EXPECT_TRUE(std::filesystem::exists(folder / "out" / "two" / "report.json"));
}

TEST_F(ListOfPairs, DoesTheOthersWhenOneFails) {
  write_volume(folder / "mask.mha", blob_scene(20, 0));
  folder.write("pairs.csv",
               "name,fixed,moving,fixed_mask\nbad,fixed.mha,moving.mha,mask.mha\ngood,fixed.mha,moving.mha,\n");
  auto command = list();
  command.push_back("--json");
  const Outcome outcome = run(command);
  EXPECT_EQ(outcome.exit_code, 1);
  const json answer = json::parse(outcome.out);
  EXPECT_EQ(answer[0]["state"], "failed");
  EXPECT_THAT(answer[0]["reason"].get<std::string>(), HasSubstr("GEOMETRY_MISMATCH"));
  EXPECT_EQ(answer[1]["state"], "done");
  EXPECT_THAT(outcome.err, HasSubstr("1 of 2 pairs failed"));
}

TEST_F(ListOfPairs, RunsSideBySideAgainstOneDaemon) {
  folder.write("pairs.csv",
               "name,fixed,moving\none,fixed.mha,moving.mha\ntwo,moving.mha,fixed.mha\nthree,fixed.mha,moving.mha\n");
  auto command = list();
  command.insert(command.end(), {"--jobs", "3"});
  const Outcome first = run(command);
  ASSERT_EQ(first.exit_code, 0) << first.err;
  // Every pair's end is told, whatever the others are at.
  for (const char* told : {"1 of 3 pairs done", "2 of 3 pairs done", "3 of 3 pairs done"})
    EXPECT_THAT(first.err, HasSubstr(told));
  EXPECT_THAT(first.out, HasSubstr("3 of 3 pairs done"));
  EXPECT_TRUE(std::filesystem::is_empty(folder / "tmp"));
  // How many run at once changes no result, nor what counts as done.
  expect_shift(folder / "out" / "one" / "displacement.mha");
  EXPECT_EQ(content_of(folder / "out" / "one" / "displacement.mha"),
            content_of(folder / "out" / "three" / "displacement.mha"));
  const Outcome again = run(list());
  EXPECT_EQ(again.exit_code, 0) << again.err;
  EXPECT_THAT(again.err, HasSubstr("3 of 3 pairs are done already"));
}

/// What a list tells that has so many pairs at once.
std::string told_by_two_pairs(int at_once) { return at_once > 1 ? "0 of 2 pairs done" : "pair 1 of 2"; }

TEST_F(ListOfPairs, HasAPairForEachCoreUnlessItIsTold) {
  const Outcome outcome = run(list());
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_THAT(outcome.err, HasSubstr(told_by_two_pairs(available_cores())));
  std::filesystem::remove_all(folder / "out");
  // As many as their threads leave cores for.
  auto command = list();
  *std::next(std::find(command.begin(), command.end(), "--threads")) = std::to_string(available_cores());
  const Outcome wide = run(command);
  EXPECT_EQ(wide.exit_code, 0) << wide.err;
  EXPECT_THAT(wide.err, HasSubstr(told_by_two_pairs(1)));
}

TEST_F(ListOfPairs, HasAPairForEachSlotOfAServer) {
  for (int slots : {1, 2}) {
    SCOPED_TRACE(slots);
    const std::string address = "unix:" + (folder / "socket").string();
    ChildProcess daemon(
        {programs + "/saltusd", "--data", folder / "data", "--listen", address, "--slots", std::to_string(slots)},
        environment());
    daemon.wait_for_output("listening on");
    auto command = list();
    command.insert(command.end(), {"--server", address});
    const Outcome outcome = run(command);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    EXPECT_THAT(outcome.err, HasSubstr(told_by_two_pairs(slots)));
    std::filesystem::remove_all(folder / "out");
    daemon.signal(SIGTERM);
    EXPECT_EQ(daemon.wait(), 0) << daemon.err();
  }
}

TEST_F(ListOfPairs, SideBySideGoesOnAfterAnInterruption) {
  auto command = list(of_some_seconds());
  command.insert(command.end(), {"--jobs", "2"});
  ChildProcess child = start(command);
  child.wait_for_output("0 of 2 pairs done");
  child.signal(SIGINT);
  EXPECT_EQ(child.wait(), 4) << child.err();
  EXPECT_TRUE(std::filesystem::is_empty(folder / "tmp"));
  const Outcome rest = run(command);
  EXPECT_EQ(rest.exit_code, 0) << rest.err;
  for (const char* name : {"one", "two"}) EXPECT_TRUE(std::filesystem::exists(folder / "out" / name / "report.json"));
}

TEST_F(ListOfPairs, SideBySideDoesTheOthersWhenOneFails) {
  write_volume(folder / "mask.mha", blob_scene(20, 0));
  folder.write("pairs.csv",
               "name,fixed,moving,fixed_mask\nbad,fixed.mha,moving.mha,mask.mha\ngood,fixed.mha,moving.mha,\n");
  auto command = list();
  command.insert(command.end(), {"--jobs", "2"});
  const Outcome outcome = run(command);
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_THAT(outcome.err, HasSubstr("saltus: pair bad: job "));
  EXPECT_THAT(outcome.err, HasSubstr("1 of 2 pairs done, 1 failed, 100 % of all"));
  EXPECT_THAT(outcome.err, HasSubstr("1 of 2 pairs failed"));
  EXPECT_TRUE(std::filesystem::exists(folder / "out" / "good" / "report.json"));
  EXPECT_THAT(content_of(folder / "out" / "summary.csv"), HasSubstr("bad,failed,"));
}

TEST_F(ListOfPairs, OnePairHasNoJobs) {
  const Outcome outcome = run({"register", "--fixed", folder / "fixed.mha", "--moving", folder / "moving.mha", "--out",
                               folder / "out", "--jobs", "2"});
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_THAT(outcome.err, HasSubstr("--jobs is given without --pairs"));
}

}  // namespace
}  // namespace saltus
