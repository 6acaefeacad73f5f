#include "client/cli/register_pairs.h"

#include "core/support/errors.h"
#include "tests/support/temporary_folder.h"

#include <gmock/gmock.h>

namespace saltus::cli {
namespace {

using testing::HasSubstr;

class ReadPairs : public testing::Test {
 protected:
  ReadPairs() {
    for (const char* name : {"a.mha", "b.mha", "c, d.mha", "p.csv", "q.csv"}) folder.write(name, "x");
  }
  std::vector<Pair> read(const std::string& text, const JobOptions& common = {}) {
    return read_pairs(folder.write("pairs.csv", text), common);
  }
  std::string refusal(const std::string& text, const JobOptions& common = {}) {
    try {
      read(text, common);
    } catch (const InvalidInput& error) {
      return error.what();
    }
    return "";
  }
  testing_support::TemporaryFolder folder;
};

TEST_F(ReadPairs, TakesColumnsInAnyOrderAndPathsFromItsFolder) {
  JobOptions common;
  common.model = "gaussian";
  const auto pairs = read(
      "\xEF\xBB\xBFmoving,fixed,name,fixed_points,moving_points\r\n"
      "b.mha,\"c, d.mha\",first,p.csv,q.csv\r\n\r\n"
      "a.mha,b.mha,,,\n",
      common);
  ASSERT_EQ(pairs.size(), 2u);
  EXPECT_EQ(pairs[0].name, "first");
  EXPECT_EQ(pairs[0].job.fixed, (folder / "c, d.mha").string());
  EXPECT_EQ(pairs[0].job.moving, (folder / "b.mha").string());
  EXPECT_EQ(pairs[0].job.moving_points, (folder / "q.csv").string());
  EXPECT_EQ(pairs[0].job.model, "gaussian");
  EXPECT_EQ(pairs[1].name, "pair_2");
  EXPECT_EQ(pairs[1].job.fixed_points, "");
}

TEST_F(ReadPairs, NamesTheLineThatCannotBeMeant) {
  EXPECT_THAT(refusal(""), HasSubstr("header"));
  EXPECT_THAT(refusal("fixed,moving\n"), HasSubstr("no pair"));
  EXPECT_THAT(refusal("fixed,name\na.mha,x\n"), HasSubstr("no column moving"));
  EXPECT_THAT(refusal("fixed,moving,colour\na.mha,b.mha,red\n"), HasSubstr("'colour'"));
  EXPECT_THAT(refusal("fixed,moving,fixed\n"), HasSubstr("twice"));
  EXPECT_THAT(refusal("fixed,moving\n\na.mha\n"), HasSubstr("line 3 has 1 fields"));
  EXPECT_THAT(refusal("fixed,moving\na.mha,nowhere.mha\n"), HasSubstr("line 2 names"));
  EXPECT_THAT(refusal("fixed,moving\na.mha,\n"), HasSubstr("names no moving image"));
  EXPECT_THAT(refusal("name,fixed,moving\n../up,a.mha,b.mha\n"), HasSubstr("cannot be a folder's"));
  EXPECT_THAT(refusal("name,fixed,moving\nx,a.mha,b.mha\nx,b.mha,a.mha\n"), HasSubstr("line 3 has the name x"));
  EXPECT_THAT(refusal("fixed,moving\n\"a.mha,b.mha\n"), HasSubstr("quote"));
  JobOptions common;
  common.fixed = "a.mha";
  EXPECT_THAT(refusal("fixed,moving\na.mha,b.mha\n", common), HasSubstr("an option gives too"));
}

// A server takes eight uploads of one certificate at a time; what it refuses for long ends the list.
TEST(JobsOnServer, AreOneForEachSlotAsFarAsOneClientMayHaveStreams) {
  EXPECT_EQ(jobs_on_server(1), 1);
  EXPECT_EQ(jobs_on_server(8), 8);
  EXPECT_EQ(jobs_on_server(9), 8);
  EXPECT_EQ(jobs_on_server(256), 8);
  EXPECT_EQ(jobs_on_server(0), 8) << "Slurm decides";
}

TEST(ListProgress, CountsPairsAndTime) {
  EXPECT_EQ(list_progress({4, 0, -1, 1, {{"a", 0.5, 30}}}), "pair 1 of 4, 13 % of all");
  EXPECT_EQ(list_progress({4, 2, 100, 1, {{"c", 0.5, 30}}}), "pair 3 of 4, 63 % of all, 2:10 min left in all");
  EXPECT_EQ(list_progress({4, 3, 100, 1, {{"d", 0.25, -1}}}), "pair 4 of 4, 81 % of all, 1:15 min left in all");
}

TEST(ListProgress, CountsPairsThatRunSideBySide) {
  EXPECT_EQ(list_progress({8, 1, -1, 2, {{"b", 0.5, 30}, {"c", 0.1, -1}}}),
            "1 of 8 pairs done, 20 % of all; b 50 %, c 10 %");
  // 90 s for the slower one of the two that run, then four more of 100 s, two at a time.
  EXPECT_EQ(list_progress({8, 2, 100, 2, {{"b", 0.5, 30}, {"c", 0.1, -1}}}),
            "2 of 8 pairs done, 33 % of all, 4:50 min left in all; b 50 %, c 10 %");
  EXPECT_EQ(list_progress({8, 2, -1, 2, {{"c", 0.5, 30}, {"d", 0.5, 30}}, 1}),
            "1 of 8 pairs done, 1 failed, 38 % of all; c 50 %, d 50 %");
}

}  // namespace
}  // namespace saltus::cli
