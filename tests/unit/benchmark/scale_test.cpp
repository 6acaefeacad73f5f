#include "tests/benchmark/scale.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <sstream>

#include "tests/support/temporary_folder.h"

namespace saltus::benchmark {
namespace {

/// A program that prints what a run would, and takes as much memory as a run that large.
class ScaleRows : public ::testing::Test {
 protected:
  testing_support::TemporaryFolder folder_;
  std::vector<Row> rows(const std::string& script, const std::vector<int>& sizes) {
    const auto program = folder_.write("program", "#!/bin/sh\n" + script);
    std::filesystem::permissions(program, std::filesystem::perms::owner_all);
    std::ostringstream progress;
    return scale_rows(program, sizes, "auto", folder_ / "out", progress);
  }
};

TEST_F(ScaleRows, HaveWhatTheRunsSayAndTheirMemory) {
  const std::vector<Row> found = rows("test $1 = scale-child && echo $2 40 1000\n", {64, 128});
  ASSERT_EQ(found.size(), 2u);
  EXPECT_EQ(found[1].name, "128^3");
  EXPECT_EQ(*found[1].find("cpu_seconds"), 128);
  EXPECT_EQ(*found[1].find("iterations"), 40);
  EXPECT_NEAR(*found[0].find("share_of_declared"), 0.1 * *found[0].find("peak_megabytes"), 1e-9);
  EXPECT_TRUE(found[0].complaints.empty());
  const ScatterPlot plot = plot_of_scale(found);
  ASSERT_EQ(plot.panels.size(), 2u);
  EXPECT_EQ(plot.panels[0].series[0].points[1].y, 128);
  // Eight times the voxels, an eighth of the time.
  EXPECT_DOUBLE_EQ(plot.panels[0].series[1].points[0].y, 16);
  EXPECT_THAT(to_svg(plot), ::testing::HasSubstr("stroke-dasharray"));
}

TEST_F(ScaleRows, ComplainOfMoreMemoryThanDeclared) {
  const std::vector<Row> found = rows("dd if=/dev/zero of=/dev/null bs=300M count=1 2>/dev/null; echo 1 1 200\n", {64});
  ASSERT_EQ(found[0].complaints.size(), 1u);
  EXPECT_THAT(found[0].complaints[0], ::testing::HasSubstr("declares"));
}

// A run of 100 MiB at 2^3 would be one of terabytes at 64^3.
TEST_F(ScaleRows, LeaveOutWhatWouldNotFit) {
  const std::vector<Row> found =
      rows("dd if=/dev/zero of=/dev/null bs=100M count=1 2>/dev/null; echo 1 1 900\n", {2, 256});
  EXPECT_EQ(found[0].outcome, "done");
  EXPECT_THAT(found[1].outcome, ::testing::HasSubstr("left out"));
  EXPECT_TRUE(found[1].complaints.empty());
}

TEST_F(ScaleRows, ComplainOfARunThatFails) {
  for (const char* script : {"exit 3\n", "echo nothing\n"}) {
    const std::vector<Row> found = rows(script, {64});
    EXPECT_EQ(found[0].complaints.size(), 1u);
    EXPECT_EQ(plot_of_scale(found).panels.size(), 0u);
  }
}

}  // namespace
}  // namespace saltus::benchmark
