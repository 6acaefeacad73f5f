#include "server/launch/memory_kills.h"

#include "tests/support/kernel_files.h"

#include <gtest/gtest.h>

namespace saltus::server {
namespace {

using MemoryKills = testing_support::KernelFiles;

TEST_F(MemoryKills, OfTheFirstVersion) {
  write("proc/self/cgroup", "5:devices:/a\n4:memory:/system.slice/saltusd.service\n0::/a\n");
  write("sys/fs/cgroup/memory/system.slice/saltusd.service/memory.oom_control",
        "oom_kill_disable 0\nunder_oom 0\noom_kill 3\n");
  EXPECT_EQ(memory_kills(folder_.path()), 3);
}

TEST_F(MemoryKills, OfTheSecondVersion) {
  write("proc/self/cgroup", "0::/system.slice/saltusd.service\n");
  write("sys/fs/cgroup/system.slice/saltusd.service/memory.events", "low 0\nhigh 1\nmax 2\noom 4\noom_kill 5\n");
  EXPECT_EQ(memory_kills(folder_.path()), 5);
}

TEST_F(MemoryKills, NobodyKnowsWithoutAGroup) {
  EXPECT_FALSE(memory_kills(folder_.path()));
  write("proc/self/cgroup", "4:memory:/gone\nno line of it\n0::/\n");
  EXPECT_FALSE(memory_kills(folder_.path()));
  write("sys/fs/cgroup/memory.events", "low 0\n");
  EXPECT_FALSE(memory_kills(folder_.path()));
}

}  // namespace
}  // namespace saltus::server
