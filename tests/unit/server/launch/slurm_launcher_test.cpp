// The launcher against a Slurm that the test plays: a queue in memory behind sbatch, squeue and scancel.
#include "server/launch/slurm_launcher.h"

#include "tests/support/server_fakes.h"
#include "tests/support/temporary_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <sys/stat.h>

#include <map>
#include <sstream>

namespace saltus::server {
namespace {

using namespace std::chrono_literals;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::SizeIs;
using ::testing::StartsWith;
using testing_support::content_of;

/// What sbatch, squeue and scancel do, and how they can fail.
class FakeSlurm {
 public:
  struct Job {
    std::string name, state = "PENDING", script;
    int wait_status = 0;
    std::string host = "n/a", reason = "None";
    std::vector<std::string> arguments;
  };

  CommandResult run(const Command& command) {
    ++calls;
    if (is_away) return failure("error: Unable to contact slurm controller (connect failure)");
    const std::string& program = command.arguments.at(0);
    if (program == "sbatch") return sbatch(command);
    if (program == "squeue") return squeue();
    if (program == "scancel") return scancel(command);
    return {CommandResult::End::NotStarted, 2, "", ""};
  }

  std::string only_live() const {
    std::string found;
    for (const auto& [id, job] : jobs)
      if (job.state == "PENDING" || job.state == "RUNNING") found = found.empty() ? id : "several";
    return found;
  }

  std::map<std::string, Job> jobs;
  int calls = 0, looks = 0;
  bool is_away = false;
  bool loses_answers = false;  ///< sbatch takes the job, and its answer gets lost
  std::string refuses;         ///< what sbatch says instead of taking a job
  bool keeps_refused = false;  ///< what it refuses is in the queue all the same
  bool drops_scancel = false;  ///< scancel cannot reach the controller
  std::vector<std::vector<std::string>> cancels;

 private:
  static CommandResult failure(const std::string& text) { return {CommandResult::End::Exited, 1, "", text + "\n"}; }

  CommandResult sbatch(const Command& command) {
    Job job;
    job.arguments = command.arguments;
    job.script = command.input;
    for (const std::string& argument : command.arguments)
      if (argument.starts_with("--job-name=")) job.name = argument.substr(11);
    if (!refuses.empty() && keeps_refused) {
      job.state = "FAILED";
      job.wait_status = 1;
      job.reason = "BadConstraints";
      jobs[std::to_string(++last_id_)] = job;
    }
    if (!refuses.empty()) return failure("sbatch: error: " + refuses);
    const std::string id = std::to_string(++last_id_);
    int array = 0;
    for (const std::string& argument : command.arguments)
      if (argument.starts_with("--array=1-")) array = std::stoi(argument.substr(10));
    for (int task = 1; task <= array; ++task) jobs[id + "_" + std::to_string(task)] = job;
    if (array == 0) jobs[id] = job;
    if (loses_answers) return {CommandResult::End::TimedOut, 0, "", ""};
    return {CommandResult::End::Exited, 0, id + "\n", ""};
  }

  CommandResult squeue() {
    ++looks;
    std::ostringstream out;
    for (const auto& [id, job] : jobs)
      out << id << "   |" << job.name << "   |" << job.state << " |" << job.wait_status << " |" << job.host << " |"
          << job.reason << " \n";
    return {CommandResult::End::Exited, 0, out.str(), ""};
  }

  CommandResult scancel(const Command& command) {
    if (drops_scancel) return failure("scancel: error: Socket timed out on send/recv operation");
    cancels.emplace_back(command.arguments.begin() + 1, command.arguments.end());
    for (const std::string& argument : command.arguments)
      if (const auto found = jobs.find(argument); found != jobs.end())
        if (found->second.state == "PENDING" || found->second.state == "RUNNING") found->second.state = "CANCELLED";
    return {CommandResult::End::Exited, 0, "", ""};
  }

  int last_id_ = 0;
};

class SlurmLauncherTest : public ::testing::Test {
 protected:
  SlurmLauncherTest() {
    for (const char* name : {"run", "logs"}) std::filesystem::create_directory(folder / name);
    settings.batch.worker = "/opt/saltus/bin/saltus-worker";
    settings.batch.server_address = "login.example:8443";
    settings.tag = "ab12";
    settings.run = folder / "run";
    settings.logs = folder / "logs";
    settings.log = [this](const std::string& line) { log.push_back(line); };
    restart();
  }

  /// As after a crash of the daemon: Slurm stays, what the launcher knew is gone.
  void restart() {
    launcher = std::make_unique<SlurmLauncher>(
        settings, clock, [this](const Command& command, auto, auto) { return slurm.run(command); }, false);
    launcher->on_news([this](const AttemptKey& key, const QueueNews& told) { news[key].push_back(told); });
    launcher->on_exit([this](const AttemptKey& key, const WorkerExit& exit) { exits[key].push_back(exit); });
  }
  LaunchRequest request(const std::string& job = "job-1", int attempt = 1) {
    return {{job, attempt}, "5ec4e7", 3, {}, 0};
  }
  /// Every look that is due within `time`, in order.
  void pass(std::chrono::milliseconds time) {
    launcher->step();
    for (auto done = 0ms; done < time; done += 1s) {
      clock->advance(1s);
      launcher->step();
    }
  }
  void look() { pass(settings.poll); }
  FakeSlurm::Job& only_job() {
    EXPECT_THAT(slurm.jobs, SizeIs(1));
    return slurm.jobs.begin()->second;
  }

  testing_support::TemporaryFolder folder;
  std::shared_ptr<testing_support::FakeClock> clock = std::make_shared<testing_support::FakeClock>();
  SlurmSettings settings;
  FakeSlurm slurm;
  std::vector<std::string> log;
  std::map<AttemptKey, std::vector<QueueNews>> news;
  std::map<AttemptKey, std::vector<WorkerExit>> exits;
  std::unique_ptr<SlurmLauncher> launcher;
  const AttemptKey key{"job-1", 1};
};

TEST_F(SlurmLauncherTest, SubmitsWhatTheJobDeclares) {
  LaunchRequest asked = request();
  asked.memory_bytes = (std::int64_t{3} << 30) + 1;
  asked.limits.wall_seconds = 600;
  settings.batch.options = {"--partition=long", "--account=lab"};
  restart();
  EXPECT_EQ(launcher->start(asked), "slurm saltus-ab12-job-1-1");
  launcher->step();
  const auto& arguments = only_job().arguments;
  for (const char* argument : {"--parsable", "--no-requeue", "--job-name=saltus-ab12-job-1-1", "--ntasks=1",
                               "--cpus-per-task=3", "--mem=3073M", "--time=12", "--partition=long", "--account=lab"})
    EXPECT_THAT(arguments, Contains(argument));
  EXPECT_EQ(news[key].back().batch_id, "1");
  EXPECT_FALSE(news[key].back().has_its_turn);
}

TEST_F(SlurmLauncherTest, SaysNothingOfMemoryAndTimeWhenTheJobDoesNot) {
  launcher->start(request());
  launcher->step();
  for (const std::string& argument : only_job().arguments) {
    EXPECT_THAT(argument, Not(StartsWith("--mem")));
    EXPECT_THAT(argument, Not(StartsWith("--time")));
  }
}

TEST_F(SlurmLauncherTest, TheTokenGoesThroughTheScriptAndNothingElse) {
  launcher->start(request());
  launcher->step();
  EXPECT_THAT(only_job().script, HasSubstr("5ec4e7"));
  for (const std::string& argument : only_job().arguments) EXPECT_THAT(argument, Not(HasSubstr("5ec4e7")));
  for (const std::string& line : log) EXPECT_THAT(line, Not(HasSubstr("5ec4e7")));
  EXPECT_TRUE(std::filesystem::is_empty(folder / "run"));
}

TEST_F(SlurmLauncherTest, WithASharedFolderTheTokenIsAFileOfTheOwnerThere) {
  settings.batch.shared_data = "/mnt/saltus";
  restart();
  launcher->start(request());
  launcher->step();
  EXPECT_THAT(only_job().script, Not(HasSubstr("5ec4e7")));
  EXPECT_THAT(only_job().script, HasSubstr("'/mnt/saltus/run/job-1-1.token'"));
  EXPECT_THAT(only_job().script, HasSubstr("'--blobs' '/mnt/saltus/blobs/sha256'"));
  EXPECT_THAT(only_job().arguments, Contains("--output=/mnt/saltus/logs/job-1-1.log"));
  struct stat status {};
  ASSERT_EQ(stat((folder / "run/job-1-1.token").c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777, 0600u);
  EXPECT_EQ(content_of(folder / "run/job-1-1.token"), "5ec4e7");
  only_job().state = "COMPLETED";
  look();
  EXPECT_FALSE(std::filesystem::exists(folder / "run/job-1-1.token"));
}

struct Ending {
  const char* state;
  int wait_status;
  WorkerExit::Kind kind;
  int number;
};
class SlurmEndings : public SlurmLauncherTest, public ::testing::WithParamInterface<Ending> {};

TEST_P(SlurmEndings, AreToldOnceAsWhatTheyAre) {
  launcher->start(request());
  launcher->step();
  only_job().state = "RUNNING";
  look();
  EXPECT_TRUE(news[key].back().has_its_turn);
  EXPECT_THAT(exits[key], IsEmpty());
  only_job().state = GetParam().state;
  only_job().wait_status = GetParam().wait_status;
  look();
  look();
  ASSERT_THAT(exits[key], SizeIs(1));
  EXPECT_EQ(exits[key][0].kind, GetParam().kind);
  EXPECT_EQ(exits[key][0].number, GetParam().number);
  EXPECT_TRUE(launcher->is_idle());
}

INSTANTIATE_TEST_SUITE_P(Slurm, SlurmEndings,
                         ::testing::Values(Ending{"COMPLETED", 0, WorkerExit::Kind::Exited, 0},
                                           Ending{"FAILED", 3 << 8, WorkerExit::Kind::Exited, 3},
                                           Ending{"FAILED", 9, WorkerExit::Kind::Signalled, 9},
                                           Ending{"FAILED", 139 << 8, WorkerExit::Kind::Signalled, 11},
                                           Ending{"OUT_OF_MEMORY", 9, WorkerExit::Kind::Exited, kOutOfMemoryExit},
                                           Ending{"TIMEOUT", 15, WorkerExit::Kind::TimeLimit, 0},
                                           Ending{"PREEMPTED", 15, WorkerExit::Kind::Preempted, 0},
                                           Ending{"NODE_FAIL", 0, WorkerExit::Kind::NodeFailed, 0},
                                           Ending{"CANCELLED", 15, WorkerExit::Kind::Withdrawn, 0}),
                         [](const auto& info) {
                           return std::string(info.param.state) + "_" + std::to_string(info.param.wait_status);
                         });

TEST_F(SlurmLauncherTest, AWordThatNobodyKnowsIsNoEnd) {
  launcher->start(request());
  launcher->step();
  for (const char* state : {"COMPLETING", "SUSPENDED", "A_NEW_WORD", "CONFIGURING"}) {
    only_job().state = state;
    look();
    EXPECT_THAT(exits[key], IsEmpty()) << state;
  }
}

TEST_F(SlurmLauncherTest, OneThatSlurmHasForgottenIsGone) {
  launcher->start(request());
  launcher->step();
  slurm.jobs.clear();
  look();
  ASSERT_THAT(exits[key], SizeIs(1));
  EXPECT_EQ(exits[key][0].kind, WorkerExit::Kind::Vanished);
}

TEST_F(SlurmLauncherTest, AControllerThatIsAwayLosesNothingAndIsNotStormed) {
  launcher->start(request());
  launcher->step();
  only_job().state = "RUNNING";
  slurm.is_away = true;
  launcher->start(request("job-2"));
  slurm.calls = 0;
  pass(1h);
  EXPECT_THAT(exits, IsEmpty());
  EXPECT_LE(slurm.calls, 3600 / 10 + 2);
  EXPECT_THAT(log, ElementsAre(HasSubstr("a submission was not taken"), HasSubstr("Slurm does not answer")));
  slurm.is_away = false;
  look();
  EXPECT_THAT(log, Contains("Slurm answers again"));
  EXPECT_THAT(exits, IsEmpty());
  EXPECT_THAT(slurm.jobs, SizeIs(2));
}

TEST_F(SlurmLauncherTest, AnAnswerThatIsLostDoublesNothing) {
  slurm.loses_answers = true;
  launcher->start(request());
  pass(1min);
  EXPECT_EQ(slurm.only_live(), "1");
  EXPECT_EQ(news[key].back().batch_id, "1");
}

TEST_F(SlurmLauncherTest, AnswersThatMeanNothingAreNoAnswers) {
  for (const char* text :
       {"oops\n", "1|a|RUNNING|0|n/a\n", "1|a|RUNNING|x|h|None\n", "|a|RUNNING|0|h|None\n", "1|a||0|h|None\n"})
    EXPECT_FALSE(parse_listing(text)) << text;
  EXPECT_THAT(*parse_listing(""), IsEmpty());
  EXPECT_THAT(*parse_listing("7 |some|body's |RUNNING |0 |node1 |None \n"), IsEmpty());
  const auto rows = *parse_listing(
      "7_3   |a name  |PENDING  |768 |n/a  |ReqNodeNotAvail, UnavailableNodes:a  \n"
      "8 |b |RUNNING |0 |node1 |None \n");
  ASSERT_THAT(rows, SizeIs(2));
  EXPECT_EQ(rows[0].host, "");
  EXPECT_EQ(rows[0].reason, "ReqNodeNotAvail, UnavailableNodes:a");
  EXPECT_EQ(rows[1].host, "node1");
  EXPECT_EQ(rows[1].reason, "");
  EXPECT_EQ(rows[0].id, "7_3");
  EXPECT_EQ(rows[0].name, "a name");
  EXPECT_EQ(rows[0].wait_status, 768);
}

TEST_F(SlurmLauncherTest, ARefusalIsRepeatedAndThenTold) {
  slurm.refuses = "Batch job submission failed: Invalid partition name specified";
  launcher->start(request());
  pass(settings.refusal_patience - 1s);
  EXPECT_THAT(exits, IsEmpty());
  pass(2 * settings.poll);
  ASSERT_THAT(exits[key], SizeIs(1));
  EXPECT_EQ(exits[key][0].kind, WorkerExit::Kind::Refused);
  EXPECT_THAT(exits[key][0].detail, HasSubstr("Invalid partition name specified"));
}

TEST_F(SlurmLauncherTest, ARefusalForOneIsNoneForTheOthers) {
  slurm.refuses = "Invalid";
  launcher->start(request());
  launcher->step();
  slurm.refuses.clear();
  launcher->start(request("job-2"));
  pass(2s);
  EXPECT_THAT(news, Contains(::testing::Key(AttemptKey{"job-2", 1})));
}

TEST_F(SlurmLauncherTest, ALimitOfTheSiteIsWaitedForHoweverLongItHolds) {
  slurm.refuses = "Job violates accounting/QOS policy (job submit limit, user's size and/or time limits)";
  launcher->start(request());
  pass(3 * settings.refusal_patience);
  EXPECT_THAT(exits, IsEmpty());
  slurm.refuses.clear();
  look();
  EXPECT_THAT(slurm.jobs, SizeIs(1));
}

TEST_F(SlurmLauncherTest, WhyItWaitsIsToldWheneverThatChanges) {
  slurm.is_away = true;
  launcher->start(request());
  look();
  EXPECT_EQ(news[key].back(), (QueueNews{"", false, "", "Slurm does not answer"}));
  slurm.is_away = false;
  slurm.refuses = "Invalid account";
  look();
  EXPECT_THAT(news[key].back().waiting_for, HasSubstr("sbatch: error: Invalid account"));
  slurm.refuses.clear();
  look();
  only_job().reason = "Priority";
  look();
  EXPECT_EQ(news[key].back(), (QueueNews{"1", false, "", "Priority"}));
  const std::size_t told = news[key].size();
  pass(1h);
  EXPECT_THAT(news[key], SizeIs(told));
  only_job().reason = "Nodes required for job are DOWN, DRAINED";
  look();
  EXPECT_EQ(news[key].back(), (QueueNews{"1", false, "", "Nodes required for job are DOWN, DRAINED"}));
  only_job().state = "RUNNING";
  only_job().host = "node3";
  only_job().reason = "None";
  look();
  EXPECT_EQ(news[key].back(), (QueueNews{"1", true, "node3", ""}));
  slurm.is_away = true;
  look();
  EXPECT_TRUE(news[key].back().has_its_turn);
}

TEST_F(SlurmLauncherTest, WhatCanNeverStartEndsAfterAWhileAndIsTakenOut) {
  launcher->start(request());
  launcher->step();
  only_job().reason = "PartitionTimeLimit";
  pass(settings.refusal_patience);
  EXPECT_THAT(exits, IsEmpty());
  pass(settings.poll);
  ASSERT_THAT(exits[key], SizeIs(1));
  EXPECT_EQ(exits[key][0].kind, WorkerExit::Kind::NeverStarts);
  EXPECT_EQ(exits[key][0].detail, "PartitionTimeLimit");
  EXPECT_EQ(only_job().state, "CANCELLED");
  EXPECT_TRUE(launcher->is_idle());
}

TEST_F(SlurmLauncherTest, WhatCanStartAfterAllIsNotEnded) {
  launcher->start(request());
  launcher->step();
  for (int round = 0; round < 3; ++round) {
    only_job().reason = "PartitionConfig";
    pass(settings.refusal_patience - settings.poll);
    only_job().reason = "Resources";
    look();
  }
  pass(3 * settings.refusal_patience);
  EXPECT_THAT(exits, IsEmpty());
  EXPECT_EQ(only_job().state, "PENDING");
}

struct Hopeless {
  const char* name;
  const char* text;
};
class SlurmHopeless : public SlurmLauncherTest, public ::testing::WithParamInterface<Hopeless> {};

TEST_P(SlurmHopeless, WhatNoNodeCouldRunIsNoDeathOfAWorker) {
  for (const bool keeps_refused : {false, true}) {
    slurm.keeps_refused = keeps_refused;
    slurm.refuses = GetParam().text;
    const LaunchRequest asked = request(keeps_refused ? "job-1" : "job-2");
    launcher->start(asked);
    pass(settings.refusal_patience - settings.poll);
    EXPECT_THAT(exits, IsEmpty());
    EXPECT_THAT(news[asked.key].back().waiting_for, HasSubstr(GetParam().text));
    pass(3 * settings.poll);
    ASSERT_THAT(exits[asked.key], SizeIs(1));
    EXPECT_EQ(exits[asked.key][0].kind, WorkerExit::Kind::NeverStarts);
    EXPECT_THAT(exits[asked.key][0].detail, HasSubstr(GetParam().text));
    exits.clear();
  }
}

INSTANTIATE_TEST_SUITE_P(
    Slurm, SlurmHopeless,
    ::testing::Values(Hopeless{"Memory", "Batch job submission failed: Requested node configuration is not available"},
                      Hopeless{"Time", "Requested time limit is invalid (missing or exceeds some limit)"}),
    [](const auto& info) { return std::string(info.param.name); });

TEST_F(SlurmLauncherTest, ANodeThatLosesWhatAJobNeedsIsNoDeathOfItsWorker) {
  launcher->start(request());
  launcher->step();
  only_job().state = "FAILED";
  only_job().wait_status = 1;
  only_job().reason = "BadConstraints";
  look();
  ASSERT_THAT(exits[key], SizeIs(1));
  EXPECT_EQ(exits[key][0].kind, WorkerExit::Kind::NeverStarts);
}

TEST_F(SlurmLauncherTest, TheNextDaemonFindsWaitingRunningAndEndedOnes) {
  for (const char* job : {"waits", "runs", "ended", "lost"}) launcher->start(request(job));
  launcher->step();
  for (auto& [id, job] : slurm.jobs) {
    if (job.name == "saltus-ab12-runs-1") job.state = "RUNNING";
    if (job.name == "saltus-ab12-ended-1") job.state = "NODE_FAIL";
  }
  std::erase_if(slurm.jobs, [](const auto& entry) { return entry.second.name == "saltus-ab12-lost-1"; });
  news.clear();
  restart();
  for (const char* job : {"waits", "runs", "ended", "lost"})
    EXPECT_TRUE(launcher->adopt({job, 1}, std::string("slurm saltus-ab12-") + job + "-1"));
  look();
  EXPECT_FALSE((news[{"waits", 1}].back().has_its_turn));
  EXPECT_TRUE((news[{"runs", 1}].back().has_its_turn));
  EXPECT_EQ((exits[{"ended", 1}].at(0).kind), WorkerExit::Kind::NodeFailed);
  EXPECT_EQ((exits[{"lost", 1}].at(0).kind), WorkerExit::Kind::Vanished);
  EXPECT_THAT(slurm.jobs, SizeIs(3));
  EXPECT_THAT(slurm.cancels, IsEmpty());
}

TEST_F(SlurmLauncherTest, WhatIsNotItsOwnIsNotAdopted) {
  EXPECT_FALSE(launcher->adopt(key, "42 1 boot"));
  EXPECT_FALSE(launcher->adopt(key, "slurm saltus-other-job-1-1"));
  EXPECT_TRUE(launcher->is_idle());
}

TEST_F(SlurmLauncherTest, JobsOfItsOwnThatNobodyKnowsAreCancelledAndNoOthers) {
  slurm.jobs["7"].name = "saltus-ab12-gone-1";
  slurm.jobs["8"].name = "saltus-ffff-other-1";
  slurm.jobs["9"].name = "of-somebody";
  launcher->step();
  EXPECT_EQ(slurm.jobs["7"].state, "CANCELLED");
  EXPECT_EQ(slurm.jobs["8"].state, "PENDING");
  EXPECT_EQ(slurm.jobs["9"].state, "PENDING");
}

TEST_F(SlurmLauncherTest, OfTwoWithOneNameOneGoesOn) {
  launcher->start(request());
  launcher->step();
  slurm.jobs["0"] = slurm.jobs["1"];
  slurm.jobs["2"] = slurm.jobs["1"];
  look();
  EXPECT_EQ(slurm.only_live(), "1");
  EXPECT_THAT(exits, IsEmpty());
}

TEST_F(SlurmLauncherTest, CancelsUntilItIsGone) {
  launcher->start(request());
  launcher->step();
  only_job().state = "RUNNING";
  look();
  slurm.drops_scancel = true;
  launcher->terminate(key);
  launcher->step();
  EXPECT_EQ(only_job().state, "RUNNING");
  slurm.drops_scancel = false;
  look();
  EXPECT_THAT(slurm.cancels, ElementsAre(ElementsAre("1")));
  look();
  EXPECT_EQ(exits[key].at(0).kind, WorkerExit::Kind::Withdrawn);
}

TEST_F(SlurmLauncherTest, AKillDoesNotWaitForTheWorker) {
  launcher->start(request());
  launcher->step();
  launcher->terminate(key);
  launcher->step();
  launcher->kill(key);
  launcher->step();
  EXPECT_THAT(slurm.cancels,
              ElementsAre(ElementsAre("1"), ElementsAre("1"), ElementsAre("--signal=KILL", "--full", "1")));
}

TEST_F(SlurmLauncherTest, OneThatWasNeverSubmittedEndsAtOnceWhenItIsCancelled) {
  slurm.is_away = true;
  launcher->step();
  launcher->start(request());
  launcher->terminate(key);
  launcher->step();
  EXPECT_THAT(exits[key], SizeIs(1));
  slurm.is_away = false;
  look();
  EXPECT_THAT(slurm.jobs, IsEmpty());
}

TEST_F(SlurmLauncherTest, OneThatMayHaveBeenSubmittedIsCancelledWhenItIsFound) {
  slurm.loses_answers = true;
  launcher->start(request());
  launcher->step();
  launcher->terminate(key);
  pass(30s);
  EXPECT_EQ(only_job().state, "CANCELLED");
  EXPECT_EQ(exits[key].at(0).kind, WorkerExit::Kind::Withdrawn);
}

TEST_F(SlurmLauncherTest, WithNothingToWatchSlurmIsLeftInPeace) {
  pass(1h);
  EXPECT_EQ(slurm.looks, 1);
}

class PilotsTest : public SlurmLauncherTest {
 protected:
  PilotsTest() {
    settings.pilots = {.most = 5, .threads = 2, .memory_bytes = std::int64_t{1} << 30, .idle_seconds = 60};
    restart();
  }
  void all_become(const char* from, const char* to) {
    for (auto& [id, job] : slurm.jobs)
      if (job.state == from) job.state = to;
  }
};

TEST_F(PilotsTest, AreSubmittedAsAnArrayWhileJobsWaitAndNoMoreThanThese) {
  launcher->want_pilots(3);
  pass(1min);
  EXPECT_THAT(slurm.jobs, SizeIs(3));
  const auto& [id, job] = *slurm.jobs.begin();
  EXPECT_EQ(id, "1_1");
  for (const char* argument : {"--array=1-3", "--cpus-per-task=2", "--mem=1024M", "--job-name=saltus-ab12-pilots"})
    EXPECT_THAT(job.arguments, Contains(argument));
  EXPECT_THAT(job.script, HasSubstr("'--threads' '2' '--idle-seconds' '60'"));
  EXPECT_THAT(job.script, Not(HasSubstr("--job'")));
}

TEST_F(PilotsTest, GoOnToTheirLimitAndNotBeyond) {
  launcher->want_pilots(3);
  look();
  all_become("PENDING", "RUNNING");
  launcher->want_pilots(100);
  pass(1min);
  EXPECT_THAT(slurm.jobs, SizeIs(5));
  all_become("RUNNING", "COMPLETED");
  look();
  EXPECT_THAT(slurm.jobs, SizeIs(8));
  all_become("PENDING", "COMPLETED");
  launcher->want_pilots(0);
  pass(1h);
  EXPECT_THAT(slurm.jobs, SizeIs(8));
}

TEST_F(PilotsTest, OfAnEarlierDaemonAreCountedAndNotCancelled) {
  launcher->want_pilots(5);
  look();
  restart();
  launcher->want_pilots(9);
  pass(1min);
  EXPECT_THAT(slurm.jobs, SizeIs(5));
  EXPECT_THAT(slurm.cancels, IsEmpty());
}

TEST_F(PilotsTest, ThatEndBadlyAreNotSubmittedOverAndOver) {
  launcher->want_pilots(1);
  for (int second = 0; second < 3600; ++second) {
    pass(1s);
    all_become("PENDING", "FAILED");
    for (auto& [id, job] : slurm.jobs) job.wait_status = 2 << 8;
  }
  // After 10, 20, ... 600 s.
  EXPECT_LE(slurm.jobs.size(), 13u);
  EXPECT_GE(slurm.jobs.size(), 8u);
  EXPECT_THAT(log, Contains(HasSubstr("a pilot has ended badly")));
}

TEST_F(PilotsTest, ThatCanNeverStartAreToldOnce) {
  launcher->want_pilots(2);
  look();
  for (auto& [id, job] : slurm.jobs) job.reason = "PartitionConfig";
  pass(1h);
  EXPECT_THAT(log, ElementsAre(HasSubstr("pilots can never start there (PartitionConfig)")));
}

TEST_F(PilotsTest, AreNotDoubledWhenAnAnswerIsLost) {
  slurm.loses_answers = true;
  launcher->want_pilots(5);
  pass(1min);
  EXPECT_THAT(slurm.jobs, SizeIs(5));
}

TEST_F(SlurmLauncherTest, ItsNameInSlurmIsMadeOnce) {
  const auto file = folder / "slurm.tag";
  EXPECT_EQ(tag_of(file, "0123abcd"), "0123abcd");
  EXPECT_EQ(tag_of(file, "ffffffff"), "0123abcd");
  folder.write("slurm.tag", "no tag;");
  EXPECT_THROW(tag_of(file, "ffffffff"), std::runtime_error);
}

}  // namespace
}  // namespace saltus::server
