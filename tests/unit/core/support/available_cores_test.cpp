#include "core/support/available_cores.h"

#include "tests/support/kernel_files.h"

#include <gtest/gtest.h>
#include <omp.h>
#include <sched.h>

#include <filesystem>
#include <string>

namespace saltus {
namespace {

namespace fs = std::filesystem;

class AvailableCores : public testing_support::KernelFiles {
 protected:
  int found() const { return available_cores(folder_.path()); }

  const int all_ = available_cores(folder_.path());  ///< without a quota
};

TEST_F(AvailableCores, AreThoseOfTheAffinity) {
  if (omp_get_proc_bind() != omp_proc_bind_false) GTEST_SKIP() << "the environment binds threads to cores";
  cpu_set_t before, one;
  ASSERT_EQ(sched_getaffinity(0, sizeof before, &before), 0);
  EXPECT_EQ(all_, CPU_COUNT(&before));
  CPU_ZERO(&one);
  ASSERT_GE(sched_getcpu(), 0);
  CPU_SET(static_cast<std::size_t>(sched_getcpu()), &one);
  ASSERT_EQ(sched_setaffinity(0, sizeof one, &one), 0);
  EXPECT_EQ(found(), 1);
  EXPECT_EQ(available_cores(), 1);
  EXPECT_EQ(sched_setaffinity(0, sizeof before, &before), 0);
}

TEST_F(AvailableCores, AreNoMoreThanAQuotaOfTheSecondVersion) {
  write("proc/self/cgroup", "0::/a.slice/b.service\n");
  write("sys/fs/cgroup/a.slice/b.service/cpu.max", "max 100000\n");
  EXPECT_EQ(found(), all_);
  write("sys/fs/cgroup/a.slice/b.service/cpu.max", "190000 100000\n");
  EXPECT_EQ(found(), 1);
  write("sys/fs/cgroup/a.slice/b.service/cpu.max", "20000 100000\n");  // less than one
  EXPECT_EQ(found(), 1);
  write("sys/fs/cgroup/a.slice/b.service/cpu.max", "100000000 100000\n");
  EXPECT_EQ(found(), all_);
}

TEST_F(AvailableCores, AreNoMoreThanAQuotaOfAGroupAround) {
  write("proc/self/cgroup", "0::/a.slice/b.service\n");
  write("sys/fs/cgroup/a.slice/b.service/cpu.max", "max 100000\n");
  write("sys/fs/cgroup/a.slice/cpu.max", "100000 100000\n");
  EXPECT_EQ(found(), 1);
}

/// A container that sees its own group as the whole.
TEST_F(AvailableCores, AreNoMoreThanAQuotaAtTheTop) {
  write("proc/self/cgroup", "0::/\n");
  write("sys/fs/cgroup/cpu.max", "100000 100000\n");
  EXPECT_EQ(found(), 1);
}

TEST_F(AvailableCores, AreNoMoreThanAQuotaOfTheFirstVersion) {
  write("proc/self/cgroup", "5:devices:/x\n4:cpu,cpuacct:/docker/1\n3:cpuset:/docker/1\n0::/\n");
  const std::string group = "sys/fs/cgroup/cpu,cpuacct/";
  write(group + "docker/1/cpu.cfs_quota_us", "-1\n");
  write(group + "docker/1/cpu.cfs_period_us", "100000\n");
  EXPECT_EQ(found(), all_);
  write(group + "docker/1/cpu.cfs_quota_us", "150000\n");
  EXPECT_EQ(found(), 1);
  // Listed in another order than that of the folder's name, of which there is a link.
  write("proc/self/cgroup", "4:cpuacct,cpu:/docker/1\n");
  EXPECT_EQ(found(), all_);
  fs::create_directory_symlink("cpu,cpuacct", folder_ / "sys/fs/cgroup/cpu");
  EXPECT_EQ(found(), 1);
  // As a container sees it that has the group's folder in the place of the whole.
  fs::remove_all(folder_ / (group + "docker"));
  EXPECT_EQ(found(), all_);
  write(group + "cpu.cfs_quota_us", "100000\n");
  write(group + "cpu.cfs_period_us", "100000\n");
  EXPECT_EQ(found(), 1);
}

TEST_F(AvailableCores, NoQuotaIsToldByFilesThatSayNothing) {
  write("proc/self/cgroup", "no line of it\n0::/a\n");
  write("sys/fs/cgroup/a/cpu.max", "\n");
  write("sys/fs/cgroup/cpu.max", "0 0\n");
  EXPECT_EQ(found(), all_);
}

}  // namespace
}  // namespace saltus
