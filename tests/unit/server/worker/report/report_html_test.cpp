#include "server/worker/report/report.h"
#include "tests/unit/server/worker/report/report_scene.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <regex>

namespace saltus::report {
namespace {

using testing::HasSubstr;
using testing::Not;

std::size_t count(const std::string& text, const std::string& part) {
  std::size_t found = 0;
  for (auto at = text.find(part); at != std::string::npos; at = text.find(part, at + part.size())) ++found;
  return found;
}

template <class Scene>
void expect_self_contained(const Scene& scene) {
  const std::string html = html_of(scene.report);
  EXPECT_THAT(html, Not(HasSubstr("http:")));
  EXPECT_THAT(html, Not(HasSubstr("https:")));
  for (const char* loader : {"<link", "<iframe", "<object", "<embed", "@import", "url(", "srcset", "fetch(",
                             "XMLHttpRequest", "WebSocket", "import(", "sendBeacon"})
    EXPECT_THAT(html, Not(HasSubstr(loader)));
  // One script, within the page; and the browser is told to load nothing at all.
  EXPECT_EQ(count(html, "<script"), 1u);
  EXPECT_EQ(count(html, "<script>"), 1u);
  EXPECT_THAT(html, HasSubstr("Content-Security-Policy\" content=\"default-src 'none'; img-src data:;"));
  EXPECT_GT(count(html, "src=\""), 10u);
  EXPECT_EQ(count(html, "src=\""), count(html, "src=\"data:image/png;base64,"));
}

TEST(ReportHtml, LoadsNothingFromAnywhere) {
  ReportScene<2> flat(3);
  flat.add_landmark({2, 5}, 1);
  expect_self_contained(flat);
  ReportScene<3> solid(3);
  solid.add_landmark({2, 5, 7}, 1);
  expect_self_contained(solid);
}

TEST(ReportHtml, ClosesWhatItOpens) {
  ReportScene<3> scene(3);
  scene.add_landmark({2, 5, 7}, 1);
  const std::string html = html_of(scene.report);
  for (const std::string tag : {"html", "head", "body", "main", "section", "div", "figure", "figcaption", "table", "tr",
                                "td", "th", "svg", "text", "span", "p", "h2"})
    EXPECT_EQ(count(html, "<" + tag + ">") + count(html, "<" + tag + " "), count(html, "</" + tag + ">")) << tag;
}

TEST(ReportHtml, ShowsThreePlanesOfAVolumeAndOneOfAFlatImage) {
  EXPECT_THAT(html_of(ReportScene<3>(3).report),
              testing::AllOf(HasSubstr("axial"), HasSubstr("coronal"), HasSubstr("sagittal")));
  EXPECT_THAT(html_of(ReportScene<2>(3).report), Not(HasSubstr("axial")));
}

TEST(ReportHtml, ShowsTheKeyNumbers) {
  ReportScene<2> scene(3);
  scene.add_landmark({2, 5}, 0.5);
  const std::string html = html_of(scene.report);
  EXPECT_THAT(html, HasSubstr("3.04 \u2192 0.5 mm"));  // hypot(0.5, 3)
  EXPECT_THAT(html, HasSubstr("72 % less"));           // 9 to 2.5
  EXPECT_THAT(html, HasSubstr("0.71 %"));              // one voxel of 140 in the interior folds
  EXPECT_THAT(html, HasSubstr("2.5 s of CPU"));
}

// What slides by oriented momenta alone must not read as if nothing did.
TEST(ReportHtml, CountsOrientedMomenta) {
  ReportScene<2> scene(3);
  scene.result.summary.levels.back().oriented_elements = 37;
  EXPECT_THAT(html_of(scene.report), HasSubstr("is not zero, beside 37 oriented momenta"));
  EXPECT_THAT(html_of(scene.report), HasSubstr(" % of the blocks, 37 oriented"));
  scene.result.summary.active_first_order_share = 0;
  scene.result.momenta.back().axis = MomentumField<2>::kOriented;
  EXPECT_THAT(html_of(scene.report), HasSubstr("37</div><div class=\"note\">turned to the interface"));
  EXPECT_THAT(html_of(scene.report), Not(HasSubstr("Active first-order sites")));
}

TEST(ReportHtml, ShowsATitleAsText) {
  ReportScene<2> scene(3);
  scene.report.title = "<script>alert('x')</script> & co";
  const std::string html = html_of(scene.report);
  EXPECT_THAT(html, Not(HasSubstr("<script>alert")));
  EXPECT_EQ(count(html, "<script"), 1u);  // the viewer's
  EXPECT_THAT(html, HasSubstr("&lt;script&gt;"));
}

TEST(ReportHtml, CarriesTheVolumesOfTheViewer) {
  const std::string html = html_of(ReportScene<3>(3).report);
  for (const char* name : {"fixed", "moving", "registered", "displacement", "jacobian"})
    EXPECT_EQ(count(html, "data-volume=\"" + std::string(name) + "\""), 1u) << name;
  EXPECT_EQ(count(html, "data-slice"), 3u + 2u);  // a slider for each plane; the script speaks of it twice
  EXPECT_EQ(count(html_of(ReportScene<2>(3).report), "data-slice min"), 0u);
}

TEST(ReportHtml, ShowsTheJumpAlongTheInterface) {
  EXPECT_THAT(html_of(ReportScene<3>(3).report),
              testing::AllOf(HasSubstr("Tangential jump"), HasSubstr("point of the largest tangential jump")));
  EXPECT_THAT(html_of(ReportScene<3>(0).report), HasSubstr("No sliding interface found"));
}

TEST(ReportHtml, DoesNotCallSteepSmoothMotionASlide) {
  ReportScene<3> scene(3);
  scene.result.momenta.pop_back();  // order 0 is left
  const std::string html = html_of(scene.report);
  EXPECT_THAT(html, testing::AllOf(HasSubstr("Where it changes most"), HasSubstr("Steepest change, smooth"),
                                   HasSubstr("Tangential change"), Not(HasSubstr("Where it slides"))));
}

TEST(ReportHtml, NamesMomentaThatAreZeroEverywhereWithoutAPicture) {
  const std::string html = html_of(ReportScene<2>(3).report);
  EXPECT_THAT(html, HasSubstr("Without a momentum anywhere: Order 1, axis x, width 4 mm."));
  EXPECT_EQ(count(html, "alt=\"Order 1"), 0u);
}

// Interface between x = 5 and 6, all along y.
TEST(ReportHtml, BeginsItsViewerWhereTheJumpIs) {
  EXPECT_THAT(html_of(ReportScene<2>(3).report), testing::ContainsRegex("start&quot;:.5,[1-9]"));
}

TEST(ReportHtml, StaysSmallWhenTheImagesAreLargeAndFullOfNoise) {
  ReportScene<3> scene(3, {160, 140, 120});
  std::mt19937 random(3);
  for (Volume<3>* image : {&scene.images.fixed, &scene.images.moving, &scene.result.warped})
    for (float& sample : image->samples) sample = static_cast<float>(random() % 1000);
  EXPECT_LT(html_of(scene.report).size(), 8u << 20);
}

TEST(ReportHtml, CopesWithAConstantImageAndNoMotion) {
  ReportScene<3> scene(0);
  for (Volume<3>* image : {&scene.images.fixed, &scene.images.moving, &scene.result.warped})
    std::fill(image->samples.begin(), image->samples.end(), 7.0f);
  std::fill(scene.result.jacobian.samples.begin(), scene.result.jacobian.samples.end(), 1.0f);
  scene.result.momenta.clear();
  scene.result.summary.history.clear();
  const std::string html = html_of(scene.report);
  EXPECT_FALSE(std::regex_search(html, std::regex("[^a-z](nan|inf)[^a-z]")));
}

}  // namespace
}  // namespace saltus::report
