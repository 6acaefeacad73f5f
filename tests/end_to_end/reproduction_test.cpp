// What a report says about how it was made is enough to make it again.
#include "tests/end_to_end/end_to_end.h"

#include <sstream>

namespace saltus {
namespace {

using nlohmann::json;
using testing_support::content_of;
using testing_support::Outcome;

class Reproduction : public testing_support::EndToEnd {};

TEST_F(Reproduction, TheCommandOfTheReportGivesTheSameBits) {
  const Outcome first = run({"register",
                             "--fixed",
                             folder / "fixed.mha",
                             "--moving",
                             folder / "moving.mha",
                             "--out",
                             folder / "first",
                             "--model",
                             "sliding",
                             "--similarity",
                             "ncc",
                             "--preset",
                             "fast",
                             "--affine",
                             "rigid",
                             "--intensity-window",
                             "-0.5,1.75",
                             "--crop",
                             "2,3:46,47",
                             "--set",
                             "regularisation=0.0003",
                             "--set",
                             "time_steps=4",
                             "--threads",
                             "1"});
  ASSERT_EQ(first.exit_code, 0) << first.err;
  const json report = json::parse(content_of(folder / "first" / "report.json"));

  std::istringstream words(report["command"].get<std::string>());
  std::vector<std::string> command;
  for (std::string word; words >> word;) command.push_back(word);
  ASSERT_EQ(command.front(), "saltus");
  command.erase(command.begin());
  for (std::string& word : command) {
    if (word == "FIXED") word = folder / "fixed.mha";
    if (word == "MOVING") word = folder / "moving.mha";
    if (word == "DIR") word = folder / "second";
  }
  command.insert(command.end(), {"--threads", "2"});  // of which there may be any number
  const Outcome second = run(command);
  ASSERT_EQ(second.exit_code, 0) << second.err;
  for (const char* name : {"displacement.nii.gz", "inverse_displacement.nii.gz", "warped.nii.gz", "jacobian.nii.gz"})
    EXPECT_EQ(content_of(folder / "first" / name), content_of(folder / "second" / name)) << name;
  const json again = json::parse(content_of(folder / "second" / "report.json"));
  EXPECT_EQ(again["command"], report["command"]);
  EXPECT_EQ(again["digests"], report["digests"]);
  EXPECT_EQ(report["digests"].size(), 2u);
}

}  // namespace
}  // namespace saltus
