#include "server/launch/memory_kills.h"

#include "tests/support/temporary_folder.h"

#include <gtest/gtest.h>

namespace saltus::server {
namespace {

namespace fs = std::filesystem;

/// A root with the files that the kernel makes, as in its documentation of control groups.
class MemoryKills : public ::testing::Test {
 protected:
  void write(const std::string& name, const std::string& text) {
    fs::create_directories((folder / name).parent_path());
    folder.write(name, text);
  }
  testing_support::TemporaryFolder folder;
};

TEST_F(MemoryKills, OfTheFirstVersion) {
  write("proc/self/cgroup", "5:devices:/a\n4:memory:/system.slice/saltusd.service\n0::/a\n");
  write("sys/fs/cgroup/memory/system.slice/saltusd.service/memory.oom_control",
        "oom_kill_disable 0\nunder_oom 0\noom_kill 3\n");
  EXPECT_EQ(memory_kills(folder.path()), 3);
}

TEST_F(MemoryKills, OfTheSecondVersion) {
  write("proc/self/cgroup", "0::/system.slice/saltusd.service\n");
  write("sys/fs/cgroup/system.slice/saltusd.service/memory.events", "low 0\nhigh 1\nmax 2\noom 4\noom_kill 5\n");
  EXPECT_EQ(memory_kills(folder.path()), 5);
}

TEST_F(MemoryKills, NobodyKnowsWithoutAGroup) {
  EXPECT_FALSE(memory_kills(folder.path()));
  write("proc/self/cgroup", "4:memory:/gone\nno line of it\n0::/\n");
  EXPECT_FALSE(memory_kills(folder.path()));
  write("sys/fs/cgroup/memory.events", "low 0\n");
  EXPECT_FALSE(memory_kills(folder.path()));
}

}  // namespace
}  // namespace saltus::server
