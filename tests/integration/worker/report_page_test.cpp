// The page in a real browser: Chromium, found at run time. Oracle: the page's own marks, its pixels, and the browser's
// complaints.
#include "server/worker/report/report.h"
#include "tests/support/child_process.h"
#include "tests/support/temporary_folder.h"
#include "tests/unit/server/worker/report/report_scene.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <png.h>

#include <filesystem>
#include <optional>
#include <set>
#include <sstream>

namespace saltus::report {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing::Not;

std::optional<fs::path> browser() {
  const char* const path = std::getenv("PATH");
  std::istringstream folders(path ? path : "");
  for (std::string folder; std::getline(folders, folder, ':');)
    for (const char* name : {"chromium", "chromium-browser", "google-chrome"})
      if (fs::exists(fs::path(folder) / name)) return fs::path(folder) / name;
  return std::nullopt;
}

struct Visit {
  std::string document, complaints;
};

class ReportPage : public testing::Test {
 protected:
  void SetUp() override {
    if (!browser()) GTEST_SKIP() << "there is no chromium on this machine; apt-get install chromium brings one";
  }

  Visit visit(const std::string& html, const std::string& fragment, std::vector<std::string> more,
              int milliseconds = 10000) {
    const fs::path file = folder_.write("report.html", html);
    std::vector<std::string> command{browser()->string(),
                                     "--headless=new",
                                     "--no-sandbox",  // which needs more rights than a test may have
                                     "--disable-gpu",
                                     "--disable-background-networking",
                                     "--disable-component-update",
                                     "--no-first-run",
                                     "--host-resolver-rules=MAP * ~NOTFOUND",
                                     "--enable-logging=stderr",
                                     "--virtual-time-budget=" + std::to_string(milliseconds),
                                     "--user-data-dir=" + (folder_ / "profile").string()};
    command.insert(command.end(), more.begin(), more.end());
    command.push_back("file://" + file.string() + fragment);
    testing_support::ChildProcess child(command, {{"HOME", folder_.path().string()}});
    EXPECT_EQ(child.wait(), 0) << child.err();
    return {child.out(), child.err()};
  }

  /// Pictures are decoded beside the page's own time, which may run out before: then it gets more of it.
  Visit document(const std::string& html, const std::string& fragment = "") {
    Visit page;
    for (int milliseconds : {10000, 100000, 1000000, 10000000}) {
      page = visit(html, fragment, {"--dump-dom"}, milliseconds);
      if (page.document.find("data-state=") != std::string::npos) break;
    }
    return page;
  }

  /// Pixels of the page, RGB.
  std::vector<std::uint8_t> picture(const std::string& html, const std::string& fragment) {
    const fs::path file = folder_ / "page.png";
    visit(html, fragment, {"--screenshot=" + file.string(), "--window-size=1200,2400", "--hide-scrollbars"});
    png_image image{};
    image.version = PNG_IMAGE_VERSION;
    if (!png_image_begin_read_from_file(&image, file.c_str())) throw std::runtime_error("no picture was taken");
    image.format = PNG_FORMAT_RGB;
    std::vector<std::uint8_t> pixels(PNG_IMAGE_SIZE(image));
    png_image_finish_read(&image, nullptr, pixels.data(), 0, nullptr);
    return pixels;
  }

  testing_support::TemporaryFolder folder_;
};

TEST_F(ReportPage, RunsItsViewerWithoutAComplaint) {
  ReportScene<3> scene(3);
  scene.add_landmark({2, 5, 7}, 1);
  for (const auto& [fragment, shown] : {std::pair{"", "wipe"}, {"#view=after", "after"}, {"#view=nonsense", "wipe"}}) {
    const Visit page = document(html_of(scene.report), fragment);
    EXPECT_THAT(page.document, HasSubstr("data-state=\"ready\"")) << fragment;
    EXPECT_THAT(page.document, HasSubstr("data-shown=\"" + std::string(shown) + "\"")) << fragment;
    EXPECT_THAT(page.complaints, Not(HasSubstr("CONSOLE"))) << fragment;
  }
}

TEST_F(ReportPage, PaintsWhatIsAskedFor) {
  const std::string html = html_of(ReportScene<2>(3).report);
  const auto fixed = picture(html, "#view=fixed"), moved = picture(html, "#view=displacement");
  ASSERT_EQ(fixed.size(), moved.size());
  std::size_t different = 0;
  std::set<std::array<std::uint8_t, 3>> colours;
  for (std::size_t i = 0; i + 2 < fixed.size(); i += 3) {
    if (std::equal(&fixed[i], &fixed[i] + 3, &moved[i])) continue;
    ++different;
    colours.insert({fixed[i], fixed[i + 1], fixed[i + 2]});
  }
  // The canvas is 640 pixels wide and changes as far as the window shows it; of the fixed image its greys are seen.
  EXPECT_GT(different, 100'000u);
  EXPECT_GT(colours.size(), 50u);
}

TEST_F(ReportPage, LoadsNothingEvenWhereSomethingAsksForIt) {
  std::string html = html_of(ReportScene<2>(3).report);
  html.insert(html.find("<footer>"), "<img src=\"http://127.0.0.1:9/x.png\"><script>document.title = 'run'</script>");
  const Visit page = document(html);
  EXPECT_THAT(page.complaints, HasSubstr("Content Security Policy"));
  EXPECT_THAT(page.complaints, HasSubstr("img-src"));
  EXPECT_THAT(page.document, Not(HasSubstr("<title>run")));
  EXPECT_THAT(page.document, HasSubstr("data-state=\"ready\""));  // its own script runs all the same
}

}  // namespace
}  // namespace saltus::report
