#include "core/support/available_memory.h"

#include "tests/support/kernel_files.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <limits>
#include <string>

namespace saltus {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kMachine = std::int64_t{16} << 30;

class AvailableMemory : public testing_support::KernelFiles {
 protected:
  void SetUp() override { write("proc/meminfo", "MemTotal:       16777216 kB\nMemFree:         1000 kB\n"); }
  std::int64_t found() const { return available_memory(folder_.path()); }
};

TEST_F(AvailableMemory, IsThatOfTheMachineWithoutALimit) {
  EXPECT_EQ(found(), kMachine);
  write("proc/self/cgroup", "4:memory:/a\n0::/b\n");
  write("sys/fs/cgroup/memory/a/memory.limit_in_bytes", "9223372036854771712\n");
  write("sys/fs/cgroup/b/memory.max", "max\n");
  EXPECT_EQ(found(), kMachine);
}

TEST_F(AvailableMemory, IsNoMoreThanALimit) {
  write("proc/self/cgroup", "0::/job_7/step_0\n");
  write("sys/fs/cgroup/job_7/step_0/memory.max", "max\n");
  write("sys/fs/cgroup/job_7/memory.max", "4294967296\n");
  EXPECT_EQ(found(), std::int64_t{4} << 30);
  write("sys/fs/cgroup/job_7/step_0/memory.max", "1073741824\n");
  EXPECT_EQ(found(), std::int64_t{1} << 30);
  write("sys/fs/cgroup/job_7/memory.high", "max\n");
  EXPECT_EQ(found(), std::int64_t{1} << 30);
  write("sys/fs/cgroup/job_7/memory.high", "536870912\n");
  EXPECT_EQ(found(), std::int64_t{1} << 29);
}

TEST_F(AvailableMemory, IsNoMoreThanALimitOfTheFirstVersion) {
  write("proc/self/cgroup", "4:memory:/docker/1\n");
  write("sys/fs/cgroup/memory/memory.limit_in_bytes", "2147483648\n");  // as the container sees it
  EXPECT_EQ(found(), std::int64_t{2} << 30);
}

TEST_F(AvailableMemory, IsTheLargestNumberWhereNothingIsTold) {
  fs::remove_all(folder_ / "proc");
  EXPECT_EQ(found(), std::numeric_limits<std::int64_t>::max());
  write("proc/meminfo", "MemTotal: what\n");
  EXPECT_EQ(found(), std::numeric_limits<std::int64_t>::max());
}

TEST(AvailableMemoryHere, IsNoMoreThanTheMachineHas) {
  EXPECT_GT(available_memory(), 0);
  // The kernel counts a little for itself in one of them.
  EXPECT_LE(available_memory(), static_cast<std::int64_t>(sysconf(_SC_PHYS_PAGES)) * sysconf(_SC_PAGESIZE) / 100 * 101);
}

}  // namespace
}  // namespace saltus
