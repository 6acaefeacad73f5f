// Oracle: the scene's numbers, which are chosen.
#include "server/worker/report/findings.h"
#include "tests/unit/server/worker/report/report_scene.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace saltus::report {
namespace {

using testing::AllOf;
using testing::Contains;
using testing::Field;
using testing::HasSubstr;
using testing::Not;

template <int Dim>
std::vector<Finding> findings_of(const ReportScene<Dim>& scene) {
  return findings(scene.report, analyse(scene.report));
}

auto finding(Verdict verdict, const std::string& part) {
  return AllOf(Field(&Finding::verdict, verdict), Field(&Finding::text, HasSubstr(part)));
}

TEST(Findings, TellThatLandmarksGotWorse) {
  ReportScene<2> scene(3);
  scene.add_landmark({2, 5}, 0.5);
  EXPECT_THAT(findings_of(scene), Contains(finding(Verdict::Good, "from 3.04 to 0.5 mm")));
  EXPECT_THAT(findings_of(scene), Contains(finding(Verdict::Good, "none of these is farther off")));
  // Given in the wrong order: where u leads to from the moving point is twice as far off.
  std::swap(scene.report.fixed_points, scene.report.moving_points);
  EXPECT_THAT(findings_of(scene), Contains(finding(Verdict::Bad, "1 landmark of these is farther off")));
}

TEST(Findings, SayThatWithoutLandmarksTheErrorIsNotKnown) {
  EXPECT_THAT(findings_of(ReportScene<2>(3)), Contains(finding(Verdict::Look, "No landmarks were given")));
}

TEST(Findings, TellFoldsAtAnInterfaceFromOthers) {
  ReportScene<2> scene(3);  // its interface lies between x = 5 and 6, and the voxel at x = 6, y = 8 folds
  EXPECT_THAT(findings_of(scene), Contains(finding(Verdict::Look, "1 voxel has")));
  scene.result.jacobian.samples[2 + 12 * 8] = -0.1f;
  EXPECT_THAT(findings_of(scene), Contains(finding(Verdict::Bad, "1 of them away from every interface")));
  std::fill(scene.result.jacobian.samples.begin(), scene.result.jacobian.samples.end(), 1.0f);
  EXPECT_THAT(findings_of(scene), Contains(finding(Verdict::Good, "Nothing folds")));
}

TEST(Findings, MeasureTheSlip) {
  const ReportScene<2> scene(3);
  const Analysis<2> analysis = analyse(scene.report);
  EXPECT_EQ(analysis.interface.faces.size(), 16u);
  EXPECT_NEAR(analysis.interface.extent, 16 * 2, 1e-9);
  EXPECT_THAT(findings_of(scene), Contains(finding(Verdict::Good, "slides along 32 mm of interface, by 6 mm")));
  EXPECT_NEAR(analysis.slip.area, 16 * 2, 1e-9);
  EXPECT_THAT(findings_of(scene), Contains(finding(Verdict::Good, "overlap by up to 0.125 mm")));
  EXPECT_THAT(findings_of(ReportScene<2>(0)), Contains(finding(Verdict::Good, "No sliding interface found")));
}

TEST(Findings, TellThatWhatSlidesAlsoOpens) {
  ReportScene<2> scene(3);
  for (SlipPoint<2>& point : scene.result.slip.points) point.gap_mm = 3.5;
  EXPECT_THAT(findings_of(scene), Contains(finding(Verdict::Look, "come apart by up to 3.5 mm")));
}

TEST(Findings, CallNothingASlideThatHasNoFirstOrderMomenta) {
  ReportScene<2> scene(3);
  scene.result.momenta.pop_back();  // order 0 is left
  EXPECT_FALSE(analyse(scene.report).may_slide);
  const auto smooth = finding(Verdict::Look, "smooth, since no first-order momenta take part, but along 32 mm");
  EXPECT_THAT(findings_of(scene),
              AllOf(Contains(smooth), Not(Contains(Field(&Finding::text, HasSubstr("The motion slides"))))));
  scene.options.model = Model::Auto;
  EXPECT_THAT(findings_of(scene), Contains(finding(Verdict::Look, "auto found too little simple shear")));
  ReportScene<2> unused(3);
  EXPECT_TRUE(analyse(unused.report).may_slide);
  unused.result.summary.active_first_order_share = 0;
  EXPECT_FALSE(analyse(unused.report).may_slide);
}

TEST(Findings, TellThatTheMotionLeavesTheMovingImage) {
  // Voxels of 2 mm along the last of 16: moved by 3 mm, 1.5 voxels, one of each column ends beyond the last, and half a
  // voxel beyond its border counts as outside.
  ReportScene<2> scene(3);
  EXPECT_NEAR(analyse(scene.report).share_beyond_moving, 1.0 / 16, 1e-9);
  EXPECT_THAT(findings_of(scene), Contains(finding(Verdict::Look, "beyond the moving image")));
}

TEST(Findings, TellHowLevelsEnded) {
  ReportScene<2> scene(3);
  for (Termination own : {Termination::Converged, Termination::Settled, Termination::NoiseFloor}) {
    scene.result.summary.levels[0].termination = own;
    EXPECT_THAT(findings_of(scene), Contains(finding(Verdict::Good, "Every level came to its end"))) << to_string(own);
  }
  scene.result.summary.levels[0].termination = Termination::IterationLimit;
  EXPECT_THAT(findings_of(scene), Contains(finding(Verdict::Look, "level 1 (iteration limit)")));
}

TEST(Findings, TellWhereFirstOrdersWereKeptOut) {
  ReportScene<2> scene(3);
  EXPECT_THAT(findings_of(scene), Not(Contains(finding(Verdict::Look, "most_active_share"))));
  scene.result.options.momenta.most_active_share = 0.25;
  scene.result.summary.levels[0].kept_out_share = 0.12;
  EXPECT_THAT(findings_of(scene), Contains(finding(Verdict::Look, "(most_active_share, 25 %): level 1, up to 12 %")));
}

TEST(Findings, CarryTheNoticesAndAnIncreaseOfDissimilarity) {
  ReportScene<2> scene(3);
  scene.result.summary.notices = {"fixed image is 7 everywhere"};
  scene.result.summary.similarity_after = 10;
  EXPECT_THAT(findings_of(scene), AllOf(Contains(finding(Verdict::Look, "7 everywhere")),
                                        Contains(finding(Verdict::Bad, "no better than before"))));
}

}  // namespace
}  // namespace saltus::report
