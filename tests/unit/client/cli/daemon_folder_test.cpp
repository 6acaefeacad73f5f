#include "client/cli/daemon_folder.h"

#include "tests/support/temporary_folder.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

namespace saltus::cli {
namespace {

namespace fs = std::filesystem;

/// A command that is killed.
[[noreturn]] void leave_one() {
  const DaemonFolder left;
  fs::create_directory(left.path() / "data");
  std::ofstream(left.path() / "data" / "image") << "a patient's";
  _exit(0);
}

class DaemonFolders : public testing::Test {
 protected:
  DaemonFolders() {
    if (const char* former = std::getenv("TMPDIR")) former_ = former;
    setenv("TMPDIR", folder.path().c_str(), 1);
  }
  ~DaemonFolders() override {
    if (former_)
      setenv("TMPDIR", former_->c_str(), 1);
    else
      unsetenv("TMPDIR");
  }
  static std::string machine() {
    char name[256] = {};
    EXPECT_EQ(gethostname(name, sizeof name - 1), 0);
    return name;
  }
  /// A folder as a command leaves it that is killed on `machine`.
  fs::path make_left(const std::string& name, const std::string& machine) const {
    fs::create_directory(folder / name);
    std::ofstream(folder / name / "lock") << machine;
    return folder / name;
  }

  testing_support::TemporaryFolder folder;

 private:
  std::optional<std::string> former_;
};

TEST_F(DaemonFolders, AreOpenToTheirUserAloneAndGoWithTheObject) {
  {
    const DaemonFolder own;
    EXPECT_EQ(own.path().parent_path(), folder.path());
    struct stat about {};
    ASSERT_EQ(stat(own.path().c_str(), &about), 0);
    EXPECT_EQ(about.st_mode & 0777u, 0700u);
    std::ofstream(own.path() / "log") << "x";
  }
  EXPECT_TRUE(fs::is_empty(folder.path()));
}

TEST_F(DaemonFolders, LeftByAKilledCommandAreRemovedByTheNext) {
  EXPECT_EXIT(leave_one(), testing::ExitedWithCode(0), "");
  EXPECT_EXIT(leave_one(), testing::ExitedWithCode(0), "");  // removes the first, leaves its own
  ASSERT_EQ(folder.count(), 1u);
  const fs::path left = fs::directory_iterator(folder.path())->path();
  ASSERT_TRUE(fs::exists(left / "data" / "image"));
  const DaemonFolder next;
  EXPECT_FALSE(fs::exists(left));
  EXPECT_TRUE(fs::exists(next.path()));
}

TEST_F(DaemonFolders, StayWhileTheirCommandLives) {
  const DaemonFolder one, two, three;
  for (const DaemonFolder* living : {&one, &two, &three}) EXPECT_TRUE(fs::exists(living->path()));
}

// The daemon of a killed command has inherited the lock.
TEST_F(DaemonFolders, StayWhileAnybodyHoldsTheirLock) {
  const fs::path left = make_left("saltus-abcdef", machine());
  const int command = open((left / "lock").c_str(), O_RDWR | O_CLOEXEC);
  ASSERT_GE(command, 0);
  ASSERT_EQ(flock(command, LOCK_EX | LOCK_NB), 0);
  const int daemon = dup(command);
  close(command);
  { const DaemonFolder next; }
  EXPECT_TRUE(fs::exists(left));
  close(daemon);
  { const DaemonFolder next; }
  EXPECT_FALSE(fs::exists(left));
}

TEST_F(DaemonFolders, OfOthersStay) {
  fs::create_directory(folder / "saltus-abcdef");
  std::ofstream(folder / "saltus-abcdef" / "notes") << "no lock";
  folder.write("saltus-abcdeg", "a file");
  make_left("saltus-abcdeh", "another machine");
  make_left("saltus-results", machine());  // no name that mkdtemp makes
  fs::create_directory_symlink(make_left("elsewhere", machine()), folder / "saltus-abcdei");
  { const DaemonFolder next; }
  for (const char* name : {"saltus-abcdef/notes", "saltus-abcdeg", "saltus-abcdeh/lock", "saltus-results/lock",
                           "saltus-abcdei/lock", "elsewhere/lock"})
    EXPECT_TRUE(fs::exists(folder / name)) << name;
}

}  // namespace
}  // namespace saltus::cli
