#include "tests/benchmark/peers/peers.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <iterator>
#include <sstream>
#include <stdexcept>

#include "tests/support/temporary_folder.h"

namespace saltus::benchmark {
namespace {

using ::testing::HasSubstr;

PeerRun run_of(const std::string& scene, const std::string& pair, const std::string& family, const std::string& choice,
               double cpu, double error, const std::string& setting = "s") {
  PeerRun run{scene, pair, family, choice, 1, setting, {}};
  run.row.outcome = "done";
  run.row.figures = {{"cpu_seconds", cpu}, {"error_mm", error}, {"before_mm", 9}, {"worst_mm", 3 * error}};
  return run;
}

TEST(RunStore, KeepsRunsAndKnowsThoseOfTheSameSetting) {
  testing_support::TemporaryFolder folder;
  const auto file = folder.path() / "runs.json";
  {
    RunStore store(file);
    store.put(run_of("liver", "a1", "saltus", "fast", 3, 2));
    store.put(run_of("liver", "a1", "elastix", "", 4, 1));
    PeerRun complaint = run_of("liver", "a1", "elastix", "", 5, 1.5, "other");
    complaint.row.complaints = {"too slow"};
    store.put(complaint);  // in the place of the one before
  }
  RunStore store(file);
  ASSERT_EQ(store.runs().size(), 2u);
  EXPECT_NE(store.find(run_of("liver", "a1", "saltus", "fast", 0, 0)), nullptr);
  EXPECT_EQ(store.find(run_of("liver", "a1", "saltus", "fast", 0, 0, "new build")), nullptr);
  EXPECT_EQ(store.find(run_of("liver", "a2", "saltus", "fast", 0, 0)), nullptr);
  EXPECT_EQ(store.find(run_of("liver", "a1", "saltus", "balanced", 0, 0)), nullptr);
  PeerRun two = run_of("liver", "a1", "saltus", "fast", 0, 0);
  two.threads = 2;
  EXPECT_EQ(store.find(two), nullptr);
  const PeerRun* elastix = store.find(run_of("liver", "a1", "elastix", "", 0, 0, "other"));
  ASSERT_NE(elastix, nullptr);
  EXPECT_EQ(*elastix->row.find("error_mm"), 1.5);
  EXPECT_EQ(elastix->row.complaints, std::vector<std::string>{"too slow"});
}

TEST(RunStore, RefusesAFileOfAnotherKind) {
  testing_support::TemporaryFolder folder;
  const auto file = folder.path() / "runs.json";
  for (const char* text : {"", "[]", "{\"runs\": [{}]}", "nothing"}) {
    std::ofstream(file) << text;
    EXPECT_THROW(RunStore{file}, std::runtime_error) << text;
  }
}

// Oracle: by hand.
TEST(MeansByScene, AreOfMethodsThatWereRunOnAllPairs) {
  std::vector<PeerRun> runs = {
      run_of("liver", "a1", "saltus", "accurate", 30, 1), run_of("liver", "a1", "elastix", "", 5, 2),
      run_of("liver", "a2", "elastix", "", 7, 4),         run_of("liver", "a2", "saltus", "accurate", 50, 2),
      run_of("liver", "a1", "saltus", "fast", 3, 3),      run_of("slip", "slip", "saltus", "fast", 1, 0.5)};
  runs[1].row.add("drag", 0.2);  // one of both has it
  const std::vector<PeerRun> means = means_by_scene(runs);
  ASSERT_EQ(means.size(), 3u);
  EXPECT_EQ(means[0].method(), "saltus accurate");
  EXPECT_EQ(means[0].pair, "2 pairs");
  EXPECT_EQ(*means[0].row.find("cpu_seconds"), 40);
  EXPECT_EQ(*means[0].row.find("error_mm"), 1.5);
  EXPECT_EQ(*means[0].row.find("worst_mm"), 6) << "the worst of all";
  EXPECT_EQ(means[1].method(), "elastix");
  EXPECT_EQ(*means[1].row.find("drag"), 0.2);
  EXPECT_EQ(means[2].scene, "slip");
}

TEST(MeansByScene, GoFromTheCheapestToTheDearestSetting) {
  const std::vector<PeerRun> means =
      means_by_scene({run_of("s", "s", "elastix", "", 1, 1), run_of("s", "s", "saltus", "accurate", 1, 1),
                      run_of("s", "s", "saltus", "fast", 1, 1), run_of("s", "s", "saltus", "balanced", 1, 1)});
  ASSERT_EQ(means.size(), 4u);
  EXPECT_EQ(means[0].choice, "fast");
  EXPECT_EQ(means[1].choice, "balanced");
  EXPECT_EQ(means[2].choice, "accurate");
  EXPECT_EQ(means[3].family, "elastix");
}

TEST(PrintPeers, HasARowForEachMethod) {
  std::vector<PeerRun> means = means_by_scene(
      {run_of("slip", "slip", "saltus", "fast", 1.25, 0.5), run_of("slip", "slip", "elastix", "", 2, 1)});
  means[1].row.complaints = {"bad"};
  std::ostringstream out;
  print_peers(out, means);
  EXPECT_THAT(out.str(), HasSubstr("\n| slip (9.00) | saltus fast | 1 | 0.50 |"));
  EXPECT_THAT(out.str(), HasSubstr("\n|  | elastix **bad** | 1 | 1.00 |"));
}

TEST(PublishPeers, PutsTheSummaryBetweenItsLinesAndNothingElse) {
  testing_support::TemporaryFolder folder;
  std::filesystem::create_directories(folder / "deploy/pictures");
  std::filesystem::create_directories(folder / "tests/benchmark");
  PeerRun slip = run_of("slip", "slip", "saltus", "fast", 1.25, 0.5);
  slip.row.add("near_mm", 1.5);
  const std::vector<PeerRun> means = means_by_scene({slip, run_of("smooth", "smooth", "elastix", "", 2, 1)});
  const auto readme = folder / "README.md";
  std::ofstream(readme) << "nothing";
  EXPECT_THROW(publish_peers(folder.path(), means), std::runtime_error);
  std::ofstream(readme) << "before\n<!-- peers -->\nold\n<!-- end of peers -->\nafter\n";
  for (int repetition = 0; repetition < 2; ++repetition) publish_peers(folder.path(), means);
  std::ifstream file(readme);
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  EXPECT_THAT(text, ::testing::StartsWith("before\n<!-- peers -->\n![Error"));
  EXPECT_THAT(text, ::testing::EndsWith("|\n<!-- end of peers -->\nafter\n"));
  EXPECT_THAT(text, HasSubstr("| saltus fast | 0.50 / 1.50; 1.2 |  |\n"));
  EXPECT_THAT(text, HasSubstr("| elastix |  | 1.00; 2.0 |\n"));
  EXPECT_TRUE(std::filesystem::exists(folder / "deploy/pictures/error_against_time.svg"));
  EXPECT_TRUE(std::filesystem::exists(folder / "tests/benchmark/peers_table.md"));
}

TEST(PlotOf, HasPanelsForLandmarksOutsideAndNearTheInterface) {
  PeerRun liver = run_of("liver", "a", "saltus", "fast", 3, 2), slip = run_of("slip", "slip", "saltus", "fast", 1, 0.5);
  liver.row.add("outside_mm", 4);
  slip.row.add("near_mm", 1.5);
  PeerRun two = slip;
  two.threads = 2;
  const ScatterPlot plot = plot_of({liver, slip, two, run_of("smooth", "smooth", "saltus", "fast", 1, 1)});
  ASSERT_EQ(plot.panels.size(), 5u);
  EXPECT_EQ(plot.panels[1].series[0].points[0].y, 4);
  EXPECT_EQ(plot.panels[3].series[0].points.size(), 1u) << "of one number of threads";
  EXPECT_EQ(plot.panels[3].series[0].points[0].y, 1.5);
  EXPECT_THAT(to_svg(plot), HasSubstr("before: 9.00 mm"));
}

TEST(RunPeers, RefusesAMethodThatItDoesNotKnow) {
  testing_support::TemporaryFolder folder;
  PeersOptions options;
  options.out = folder.path();
  options.methods = {"nobody"};
  std::ostringstream log;
  EXPECT_THROW(run_peers(options, log), std::runtime_error);
}

}  // namespace
}  // namespace saltus::benchmark
