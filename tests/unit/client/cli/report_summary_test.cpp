#include "client/cli/report_summary.h"

#include "core/support/errors.h"
#include "tests/support/temporary_folder.h"

#include <gmock/gmock.h>
#include <nlohmann/json.hpp>

namespace saltus::cli {
namespace {

using testing::HasSubstr;

TEST(ReportSummary, TellsTheNumbersThatMatter) {
  const nlohmann::json report{{"model", "sliding"},
                              {"similarity", "ssd"},
                              {"preset", "fast"},
                              {"termination", "converged"},
                              {"seconds", {{"wall", 12.34}, {"cpu", 20.0}}},
                              {"peak_memory_bytes", 47009792},
                              {"similarity_value", {{"before", 74.86}, {"after", 49.52}}},
                              {"landmark_error_mm", {{"before", {{"mean", 13.51}}}, {"after", {{"mean", 2.96}}}}},
                              {"displacement_mm", {{"mean", 4.5}, {"max", 21.25}}},
                              {"jacobian", {{"min", 0.25}, {"max", 2.5}, {"share_not_positive", 0.0015}}},
                              {"inverse_consistency_mm", 0.012}};
  EXPECT_EQ(report_summary(report),
            "model         sliding, ssd, fast\n"
            "ended         converged after 12.3 s (20 s of CPU, 47 MB)\n"
            "similarity    74.9 -> 49.5\n"
            "landmarks     13.5 -> 2.96 mm mean error\n"
            "displacement  4.5 mm mean, 21.2 mm at most\n"
            "jacobian      0.25 to 2.5, 0.15 % not positive\n"
            "inverse       0.012 mm median error\n");
}

TEST(ReportSummary, ShowsNotices) {
  const std::string text = report_summary({{"notices", {"one thing", "another"}}});
  EXPECT_THAT(text, HasSubstr("notice        one thing\nnotice        another\n"));
}

TEST(ReportSummary, MarksWhatIsNotThere) {
  const std::string text = report_summary(nlohmann::json::object());
  EXPECT_THAT(text, HasSubstr("similarity    - -> -"));
  EXPECT_EQ(text.find("landmarks"), std::string::npos);
}

TEST(ReadReport, NamesTheFileThatIsNoReport) {
  testing_support::TemporaryFolder folder;
  const auto file = folder.write("report.json", "{");
  EXPECT_THAT([&] { read_report(file); }, testing::ThrowsMessage<FileError>(HasSubstr(file.string())));
  EXPECT_THROW(read_report(folder / "nothing.json"), FileError);
}

}  // namespace
}  // namespace saltus::cli
