#include "server/launch/local_launcher.h"

#include "core/support/available_cores.h"
#include "server/launch/process_identity.h"
#include "server/launch/worker_environment.h"
#include "tests/support/temporary_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <signal.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <condition_variable>
#include <thread>

namespace saltus::server {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using testing_support::content_of;

class LocalLauncherTest : public ::testing::Test {
 protected:
  LocalLauncherTest() {
    for (const char* name : {"run", "logs", "uploads"}) fs::create_directory(folder / name);
  }
  ~LocalLauncherTest() override { launcher.reset(); }

  /// Workers run this shell script; $folder is a folder of the test.
  void use_script(const std::string& script, int thread_budget = 0) {
    const fs::path program =
        folder.write("worker", "#!/bin/sh\nfolder=" + folder.path().string() + "\n" + script + "\n");
    fs::permissions(program, fs::perms::owner_all);
    LocalLauncherSettings settings{program, "unix:/nowhere",   folder / "run", folder / "logs", folder / "work",
                                   {},      folder / "uploads"};
    settings.thread_budget = thread_budget;
    settings.count_memory_kills = [this] { return memory_kills_now.load(); };
    launcher = std::make_unique<LocalLauncher>(settings);
    launcher->on_exit([this](const AttemptKey& key, const WorkerExit& exit) {
      std::lock_guard lock(mutex);
      exits[key] = exit;
      changed.notify_all();
    });
  }
  WorkerExit exit_of(const AttemptKey& key) {
    std::unique_lock lock(mutex);
    changed.wait(lock, [&] { return exits.contains(key); });
    return exits[key];
  }
  /// A pipe in the file system: reading it waits until the worker writes.
  void make_pipe(const std::string& name) { ASSERT_EQ(mkfifo((folder / name).c_str(), 0600), 0); }

  testing_support::TemporaryFolder folder;
  const AttemptKey key{"job", 1};
  std::unique_ptr<LocalLauncher> launcher;
  std::mutex mutex;
  std::condition_variable changed;
  std::map<AttemptKey, WorkerExit> exits;
  std::atomic<std::int64_t> memory_kills_now{7};
};

TEST_F(LocalLauncherTest, HandsTheTokenOverInAFileOfTheOwner) {
  use_script(R"(
    while [ $# -gt 1 ]; do case $1 in --token-file) token=$2;; esac; echo "$1=$2" >> $folder/arguments; shift 2; done
    cp -p "$token" $folder/token; env > $folder/environment; exit 3)");
  launcher->start({key, "the-secret", 5});
  const auto exit = exit_of(key);
  EXPECT_EQ(exit.kind, WorkerExit::Kind::Exited);
  EXPECT_EQ(exit.number, 3);
  EXPECT_EQ(content_of(folder / "token"), "the-secret");
  struct stat status {};
  ASSERT_EQ(stat((folder / "token").c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777, 0600u);
  const std::string arguments = content_of(folder / "arguments");
  EXPECT_THAT(arguments, HasSubstr("--server=unix:/nowhere\n"));
  EXPECT_THAT(arguments, HasSubstr("--job=job\n"));
  EXPECT_THAT(arguments, HasSubstr("--attempt=1\n"));
  const std::string environment = content_of(folder / "environment");
  EXPECT_THAT(environment, HasSubstr("OMP_NUM_THREADS=5\n"));
  EXPECT_THAT(arguments + environment, ::testing::Not(HasSubstr("the-secret")));
}

TEST_F(LocalLauncherTest, ADeathForWantOfMemoryIsToldAsOne) {
  use_script("kill -s $(cat $folder/signal) $$");
  const auto die = [&](int attempt, const char* signal) {
    folder.write("signal", signal);
    launcher->start({{"job", attempt}, "token"});
    return exit_of({"job", attempt});
  };
  EXPECT_EQ(die(1, "KILL").detail, "");
  memory_kills_now = 8;
  EXPECT_EQ(die(2, "SEGV").detail, "");
  EXPECT_EQ(die(3, "KILL").detail, "the kernel ended it because no memory was left");
  EXPECT_EQ(die(4, "KILL").detail, "");
}

TEST_F(LocalLauncherTest, RemovesTheTokenAndKeepsTheLogOfAFailure) {
  use_script("echo out; echo err >&2; exit 1");
  launcher->start({key, "t", 1});
  exit_of(key);
  EXPECT_TRUE(fs::is_empty(folder / "run"));
  EXPECT_EQ(content_of(folder / "logs/job-1.log"), "out\nerr\n");
}

TEST_F(LocalLauncherTest, RemovesTheLogOfASuccess) {
  use_script("echo out");
  launcher->start({key, "t", 1});
  exit_of(key);
  EXPECT_TRUE(fs::is_empty(folder / "logs"));
}

TEST_F(LocalLauncherTest, KeepsTheNewestLogsOnly) {
  use_script("exit 1");
  for (int i = 0; i < 70; ++i) {
    const auto file = folder.write("logs/old-" + std::to_string(i) + ".log", "x");
    fs::last_write_time(file, fs::file_time_type::clock::now() - std::chrono::hours(100 - i));
  }
  launcher->start({key, "t", 1});
  exit_of(key);
  EXPECT_FALSE(fs::exists(folder / "logs/old-5.log"));
  EXPECT_TRUE(fs::exists(folder / "logs/old-6.log"));
}

TEST_F(LocalLauncherTest, TellsASignalFromAnExit) {
  use_script("kill -SEGV $$");
  launcher->start({key, "t", 1});
  const auto exit = exit_of(key);
  EXPECT_EQ(exit.kind, WorkerExit::Kind::Signalled);
  EXPECT_EQ(exit.number, SIGSEGV);
}

TEST_F(LocalLauncherTest, WorkersHaveNothingOpenButTheirOwn) {
  use_script("ls -l /proc/$$/fd > $folder/open");
  launcher->start({key, "t", 1});
  exit_of(key);
  std::istringstream lines(content_of(folder / "open"));
  for (std::string line; std::getline(lines, line);) {
    if (line.find(" -> ") == std::string::npos) continue;
    const std::string target = line.substr(line.find(" -> ") + 4);
    EXPECT_TRUE(target == "/dev/null" || target.ends_with("job-1.log") || target.ends_with("/worker") ||
                target.ends_with("/open"))
        << line;
  }
}

TEST_F(LocalLauncherTest, TerminateReachesTheWorkerAndKillTheOneThatIgnoresIt) {
  make_pipe("ready");
  make_pipe("asked");
  use_script("trap 'echo yes > $folder/asked' TERM; echo > $folder/ready; while :; do sleep 1000 & wait $!; done");
  launcher->start({key, "t", 1});
  content_of(folder / "ready");
  launcher->terminate(key);
  EXPECT_EQ(content_of(folder / "asked"), "yes\n");
  launcher->kill(key);
  EXPECT_EQ(exit_of(key).number, SIGKILL);
}

TEST_F(LocalLauncherTest, WhatAWorkerStartedEndsWithIt) {
  make_pipe("alive");
  // The child holds the pipe open; reading ends when nobody holds it any more.
  use_script("exec 3> $folder/alive; sleep 1000 & exit 0");
  launcher->start({key, "t", 1});
  content_of(folder / "alive");
  exit_of(key);
}

TEST_F(LocalLauncherTest, AProgramThatIsNotThereIsAnError) {
  use_script("exit 0");
  fs::remove(folder / "worker");
  EXPECT_THROW(launcher->start({key, "t", 1}), std::runtime_error);
  EXPECT_TRUE(launcher->is_idle());
  EXPECT_TRUE(fs::is_empty(folder / "run"));
  EXPECT_TRUE(fs::is_empty(folder / "logs"));
  EXPECT_TRUE(fs::is_empty(folder / "work"));
}

TEST_F(LocalLauncherTest, ALogThatCannotBeWrittenLeavesNothing) {
  use_script("exit 0");
  fs::create_directory(folder / "logs/job-1.log");
  EXPECT_THROW(launcher->start({key, "t", 1}), std::runtime_error);
  EXPECT_TRUE(fs::is_empty(folder / "run"));
  EXPECT_TRUE(fs::is_empty(folder / "work"));
}

TEST_F(LocalLauncherTest, TemporaryFilesAreTheDaemonsAndGoWithTheWorker) {
  make_pipe("where");
  use_script("touch $TMPDIR/left; echo $TMPDIR > $folder/where; exec sleep 1000");
  launcher->start({key, "t", 1});
  EXPECT_EQ(content_of(folder / "where"), (folder / "work/job-1").string() + "\n");
  EXPECT_TRUE(fs::exists(folder / "work/job-1/left"));
  launcher->kill(key);
  exit_of(key);
  EXPECT_TRUE(fs::is_empty(folder / "work"));
}

TEST_F(LocalLauncherTest, WhatAWorkerHasGivenGoesWithItUnlessTheDaemonHasTakenIt) {
  make_pipe("ready");
  use_script(
      "touch $folder/uploads/given-job-1-0.5.ab.part $folder/uploads/given-job-1-1.5.cd.part; echo > $folder/ready; "
      "exec sleep 1000");
  for (const char* other : {"given-job-11-0.5.ab.part", "given-job-2-0.5.ab.part", "job-1-0.5.ab.part"})
    folder.write(std::string("uploads/") + other, "x");
  launcher->start({key, "t", 1});
  content_of(folder / "ready");
  launcher->kill(key);
  exit_of(key);
  std::set<std::string> left;
  for (const auto& entry : fs::directory_iterator(folder / "uploads")) left.insert(entry.path().filename());
  EXPECT_EQ(left, (std::set<std::string>{"given-job-11-0.5.ab.part", "given-job-2-0.5.ab.part", "job-1-0.5.ab.part"}));
}

TEST_F(LocalLauncherTest, ReadsNothingAndLeadsAGroupOfItsOwn) {
  use_script(
      "cat; read -r line < /proc/$$/stat; echo \"$line\" > $folder/stat; echo $OMP_WAIT_POLICY > $folder/policy");
  launcher->start({key, "t", 1});
  EXPECT_EQ(exit_of(key).number, 0);
  std::istringstream stat(content_of(folder / "stat"));
  std::string pid, name, state, parent, group;
  stat >> pid >> name >> state >> parent >> group;
  EXPECT_EQ(group, pid);
  EXPECT_EQ(content_of(folder / "policy"), "PASSIVE\n");
}

// Threads wait awake only where the budget says that no other worker wants their core.
TEST_F(LocalLauncherTest, ThreadsWaitAwakeOnlyWhereTheyHaveCoresOfTheirOwn) {
  const int cores = available_cores();
  for (const auto& [budget, expected] : {std::pair(0, "0"), {cores, kBriefWait}, {cores + 1, "0"}}) {
    SCOPED_TRACE(budget);
    use_script("echo $GOMP_SPINCOUNT > $folder/turns", budget);
    const AttemptKey one{"job", 10 + budget};
    launcher->start({one, "t", 1});
    EXPECT_EQ(exit_of(one).number, 0);
    EXPECT_EQ(content_of(folder / "turns"), std::string(expected) + "\n");
  }
}

TEST_F(LocalLauncherTest, MemoryComesInLargePagesUnlessTheDaemonWasToldOtherwise) {
  const char* inherited = std::getenv("GLIBC_TUNABLES");
  const std::string before = inherited ? inherited : "";
  use_script("echo $GLIBC_TUNABLES > $folder/tunables");
  int attempt = 0;
  for (const auto& [given, expected] : {std::pair(std::string(), std::string(kLargePages)),
                                        {"glibc.malloc.check=1", "glibc.malloc.check=1:" + std::string(kLargePages)},
                                        {"glibc.malloc.hugetlb=0", "glibc.malloc.hugetlb=0"}}) {
    SCOPED_TRACE(given);
    const AttemptKey one{"job", ++attempt};
    setenv("GLIBC_TUNABLES", given.c_str(), 1);
    EXPECT_NO_THROW(launcher->start({one, "t", 1}));
    setenv("GLIBC_TUNABLES", before.c_str(), 1);
    EXPECT_EQ(exit_of(one).number, 0);
    EXPECT_EQ(content_of(folder / "tunables"), expected + "\n");
  }
  if (!inherited) unsetenv("GLIBC_TUNABLES");
}

TEST_F(LocalLauncherTest, AWorkerOutlivesTheLauncherAndIsAdoptedByTheNext) {
  make_pipe("ready");
  use_script("echo > $folder/ready; exec sleep 1000");
  const std::string process = launcher->start({key, "t", 1});
  content_of(folder / "ready");
  use_script("exit 0");
  EXPECT_TRUE(launcher->is_idle());
  ASSERT_TRUE(launcher->adopt(key, process));
  EXPECT_FALSE(launcher->is_idle());
  launcher->kill(key);
  // Here the worker is a child of the test, which nobody has waited for yet; the end is seen all the same.
  EXPECT_EQ(exit_of(key).kind, WorkerExit::Kind::Vanished);
  EXPECT_FALSE(launcher->adopt({"job", 2}, process));
  waitpid(parse_identity(process)->pid, nullptr, 0);
}

TEST_F(LocalLauncherTest, AnotherProcessOfTheSameNumberIsNotAdopted) {
  use_script("exit 0");
  auto identity = *identify(getpid());
  EXPECT_EQ(parse_identity(identity.to_text()), identity);
  identity.start_time += "1";
  EXPECT_FALSE(launcher->adopt(key, identity.to_text()));
  EXPECT_FALSE(launcher->adopt(key, "no identity"));
}

TEST_F(LocalLauncherTest, StaleTokensAndTemporaryFilesAreRemoved) {
  make_pipe("ready");
  use_script("echo > $folder/ready; exec sleep 1000");
  folder.write("run/old-1.token", "x");
  fs::create_directories(folder / "work/old-1");
  folder.write("work/old-1/image.mha", "x");
  for (const char* name : {"given-old-1-0.5.ab.part", "given-job-1-0.5.ab.part", "id.5.ab.part"})
    folder.write(std::string("uploads/") + name, "x");
  launcher->start({key, "t", 1});
  content_of(folder / "ready");
  launcher->remove_stale_files();
  EXPECT_FALSE(fs::exists(folder / "run/old-1.token"));
  EXPECT_TRUE(fs::exists(folder / "run/job-1.token"));
  EXPECT_FALSE(fs::exists(folder / "work/old-1"));
  EXPECT_TRUE(fs::exists(folder / "work/job-1"));
  EXPECT_FALSE(fs::exists(folder / "uploads/given-old-1-0.5.ab.part"));
  EXPECT_TRUE(fs::exists(folder / "uploads/given-job-1-0.5.ab.part"));
  EXPECT_TRUE(fs::exists(folder / "uploads/id.5.ab.part"));
  launcher->kill(key);
  exit_of(key);
}

}  // namespace
}  // namespace saltus::server
