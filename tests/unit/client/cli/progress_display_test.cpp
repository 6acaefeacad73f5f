#include "client/cli/progress_display.h"

#include <gmock/gmock.h>

#include <sstream>

namespace saltus::cli {
namespace {

v1::RegistrationJob optimising(int level, int iteration) {
  v1::RegistrationJob job;
  job.set_state(v1::JOB_STATE_RUNNING);
  job.mutable_progress()->set_stage(v1::JOB_STAGE_OPTIMISING);
  job.mutable_progress()->set_level(level);
  job.mutable_progress()->set_levels(3);
  job.mutable_progress()->set_iteration(iteration);
  job.mutable_progress()->set_max_iterations(60);
  job.mutable_progress()->set_energy(123.5);
  job.mutable_progress()->set_fraction(0.45);
  job.mutable_progress()->set_seconds_left(12.4);
  return job;
}

TEST(FormatSeconds, UsesTheUnitThatFits) {
  EXPECT_EQ(format_seconds(0), "0 s");
  EXPECT_EQ(format_seconds(59.4), "59 s");
  EXPECT_EQ(format_seconds(59.6), "1:00 min");
  EXPECT_EQ(format_seconds(187), "3:07 min");
  EXPECT_EQ(format_seconds(7500), "2:05 h");
  EXPECT_EQ(format_seconds(-1), "?");
}

TEST(ProgressLine, TellsLevelIterationEnergyAndTimeLeft) {
  EXPECT_EQ(progress_line(optimising(2, 12)), "optimising, level 2/3, iteration 12/60, energy 123.5, 45 %, 12 s left");
  v1::RegistrationJob unknown = optimising(2, 12);
  unknown.mutable_progress()->set_seconds_left(-1);
  EXPECT_EQ(progress_line(unknown), "optimising, level 2/3, iteration 12/60, energy 123.5, 45 %");
}

TEST(ProgressLine, TellsNoEnergyBeforeThereIsOne) {
  v1::RegistrationJob job = optimising(2, 0);
  job.mutable_progress()->set_energy(0);
  EXPECT_EQ(progress_line(job), "optimising, level 2/3, iteration 0/60, 45 %, 12 s left");
}

TEST(ProgressLine, TellsOtherStatesByName) {
  v1::RegistrationJob job;
  job.set_state(v1::JOB_STATE_QUEUED);
  job.set_queue_position(3);
  EXPECT_EQ(progress_line(job), "queued, position 3");
  job.set_state(v1::JOB_STATE_RUNNING);
  job.mutable_progress()->set_stage(v1::JOB_STAGE_FETCHING);
  EXPECT_EQ(progress_line(job), "fetching");
  job.set_state(v1::JOB_STATE_SUCCEEDED);
  EXPECT_EQ(progress_line(job), "succeeded");
}

TEST(ProgressBar, FillsWithTheFractionAndFitsTheTerminal) {
  const std::string bar = progress_bar(optimising(2, 12), 200);
  EXPECT_THAT(bar, testing::StartsWith("[#########...........]  45 % optimising, level 2/3"));
  EXPECT_THAT(bar, testing::EndsWith("12 s left"));
  EXPECT_EQ(progress_bar(optimising(2, 12), 40), bar.substr(0, 40));
  v1::RegistrationJob job;
  job.set_state(v1::JOB_STATE_SUCCEEDED);
  EXPECT_THAT(progress_bar(job, 200), testing::StartsWith("[####################] 100 % succeeded"));
}

TEST(ProgressDisplay, DrawsTheBarOverItself) {
  std::ostringstream out;
  {
    ProgressDisplay display(out, DisplayStyle::Bar);
    display.show(optimising(1, 1));
    display.show(optimising(1, 2));
  }
  const std::string text = out.str();
  EXPECT_EQ(std::count(text.begin(), text.end(), '\r'), 2);
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 1);
  EXPECT_EQ(text.back(), '\n');
}

TEST(ProgressDisplay, WritesALineASecondOneForEachLevelAndNoneTwice) {
  std::ostringstream out;
  const std::chrono::steady_clock::time_point start;
  const auto after = [start](int milliseconds) { return start + std::chrono::milliseconds(milliseconds); };
  const auto lines = [&out] {
    const std::string text = out.str();
    EXPECT_EQ(text.find('\r'), std::string::npos);
    return std::count(text.begin(), text.end(), '\n');
  };
  ProgressDisplay display(out, DisplayStyle::Lines);
  display.show(optimising(1, 1), after(0));
  EXPECT_EQ(lines(), 1);
  display.show(optimising(1, 2), after(500));
  EXPECT_EQ(lines(), 1) << "too soon";
  display.show(optimising(1, 2), after(1100));
  EXPECT_EQ(lines(), 2);
  display.show(optimising(1, 2), after(2500));
  EXPECT_EQ(lines(), 2) << "nothing new";
  display.show(optimising(2, 1), after(2501));
  display.show(optimising(3, 1), after(2502));
  EXPECT_EQ(lines(), 4) << "a new level is told at once";
}

}  // namespace
}  // namespace saltus::cli
