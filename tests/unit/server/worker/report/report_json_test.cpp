// Oracle: the scene's numbers, which are chosen.
#include "core/support/errors.h"
#include "server/worker/report/report.h"
#include "tests/unit/server/worker/report/report_scene.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <limits>

namespace saltus::report {
namespace {

using nlohmann::json;

TEST(ReportJson, TellsSettingsGridsAndConvergence) {
  const ReportScene<3> scene(3);
  const json report = json::parse(json_of(scene.report));
  EXPECT_EQ(report["dimension"], 3);
  EXPECT_EQ(report["model"], "sliding");
  EXPECT_EQ(report["similarity"], "ssd");
  EXPECT_EQ(report["preset"], "fast");
  EXPECT_EQ(report["parameters"].size(), list_parameters(scene.options).size());
  EXPECT_EQ(report["parameters"]["time_steps"], scene.options.flow.time_steps);
  EXPECT_EQ(report["fixed"]["size"], json({12, 16, 20}));
  EXPECT_EQ(report["fixed"]["spacing_mm"], json({1.0, 1.0, 2.0}));
  EXPECT_EQ(report["fixed"]["origin_mm"], json({-5.0, 0.0, 0.0}));
  ASSERT_EQ(report["levels"].size(), 1u);
  EXPECT_EQ(report["levels"][0]["evaluations"], 3);
  EXPECT_EQ(report["levels"][0]["termination"], to_string(Termination::Converged));
  EXPECT_EQ(report["levels"][0]["rounds"], 2);
  EXPECT_EQ(report["levels"][0]["optimality"], 0.125);
  EXPECT_EQ(report["levels"][0]["smoothing_voxels"], 0.75);
  EXPECT_EQ(report["slip_surface"]["parts"], 1);
  EXPECT_EQ(report["slip_surface"]["least_jump_mm"], 0.25);
  EXPECT_EQ(report["slip_surface"]["gap_p95_mm"], 0);
  EXPECT_EQ(report["slip_surface"]["overlap_p95_mm"], 0.125);
  EXPECT_EQ(report["levels"][0]["similarity_weight"], 0.5);
  EXPECT_EQ(report["noise"], 0.0625);
  ASSERT_EQ(report["history"].size(), 2u);
  EXPECT_EQ(report["history"][1]["round"], 2);
  EXPECT_EQ(report["history"][1]["energy"], 4.0);
  EXPECT_EQ(report["similarity_value"], json({{"before", 9.0}, {"after", 2.5}}));
  EXPECT_EQ(report["seconds"], json({{"wall", 1.25}, {"cpu", 2.5}}));
  EXPECT_EQ(report["stage_seconds"], json({{"fetching", 0.125}}));
  EXPECT_EQ(report["peak_memory_bytes"], 1 << 20);
}

TEST(ReportJson, TellsWhatALevelDecidedOnFirstOrderMomenta) {
  ReportScene<2> scene(3);
  EXPECT_FALSE(json::parse(json_of(scene.report))["levels"][0].contains("first_order_momenta"));
  LevelSummary& level = scene.result.summary.levels[0];
  level.simple_shear = 1.75;
  scene.result.options.momenta.regularisation_beside_first = 0.125;
  scene.result.options.momenta.regularisation_beside_plain = 0.25;
  for (bool is_in : {true, false}) {
    level.was_plain = is_in;
    level.has_finer = !is_in;
    level.decision = is_in ? FirstOrderDecision::LetIn : FirstOrderDecision::LeftOut;
    json expected = {{"let_in", is_in}, {"simple_shear", 1.75}, {"was_plain", is_in}, {"finer_order_0", !is_in}};
    if (is_in) expected.update({{"is_plain", true}, {"regularisation_beside", 0.25}});
    EXPECT_EQ(json::parse(json_of(scene.report))["levels"][0]["first_order_momenta"], expected);
  }
  level.decision = FirstOrderDecision::LetIn;
  level.quick_share = 0.875;
  level.quick_after = 9;
  level.gave_up_sharp = true;
  const json found = json::parse(json_of(scene.report))["levels"][0]["first_order_momenta"];
  EXPECT_EQ(found["quick_share"], 0.875);
  EXPECT_EQ(found["quick_after"], 9);
  EXPECT_EQ(found["order_0_gave_up_sharp"], true);
}

TEST(ReportJson, TellsWhatNarrowWidthsCountAndWhy) {
  ReportScene<2> scene(3);
  EXPECT_FALSE(json::parse(json_of(scene.report))["levels"][0].contains("narrow_widths"));
  scene.result.summary.levels[0].shear_before = 3.5;
  scene.result.summary.levels[0].narrow_share = 0.125;
  EXPECT_EQ(json::parse(json_of(scene.report))["levels"][0]["narrow_widths"],
            json({{"share", 0.125}, {"simple_shear_before", 3.5}}));
}

TEST(ReportJson, TellsWhetherOrder0GotANarrowerScaleAndWhy) {
  ReportScene<2> scene(3);
  EXPECT_FALSE(json::parse(json_of(scene.report))["levels"][0].contains("narrower_order_0"));
  scene.result.summary.levels[0].simple_shear = 7.5;
  EXPECT_EQ(json::parse(json_of(scene.report))["levels"][0]["narrower_order_0"],
            json({{"added", false}, {"simple_shear", 7.5}}));
  scene.result.summary.levels[0].narrow_pull = 31.5;
  scene.result.summary.levels[0].own_pull = 15.75;
  for (bool is_added : {true, false}) {
    scene.result.summary.levels[0].has_narrower = is_added;
    EXPECT_EQ(json::parse(json_of(scene.report))["levels"][0]["narrower_order_0"],
              json({{"added", is_added}, {"pull_over_noise", 31.5}, {"at_finest_scale", 15.75}}));
  }
}

TEST(ReportJson, TellsHowManyBlocksWereKeptOut) {
  ReportScene<2> scene(3);
  EXPECT_FALSE(json::parse(json_of(scene.report))["levels"][0].contains("kept_out_block_share"));
  scene.result.summary.levels[0].kept_out_share = 0.125;
  EXPECT_EQ(json::parse(json_of(scene.report))["levels"][0]["kept_out_block_share"], 0.125);
}

TEST(ReportJson, TellsHowManyOrientedMomentaALevelHasAndWhy) {
  ReportScene<2> scene(3);
  EXPECT_FALSE(json::parse(json_of(scene.report))["levels"][0].contains("oriented_momenta"));
  scene.result.summary.levels[0].oblique_share = 0.75;
  scene.result.summary.levels[0].oriented_elements = 17;
  EXPECT_EQ(json::parse(json_of(scene.report))["levels"][0]["oriented_momenta"],
            json({{"elements", 17}, {"oblique_share", 0.75}}));
  scene.result.summary.levels[0].oblique_share = 0;  // as where all of an interface lies along an axis
  EXPECT_EQ(json::parse(json_of(scene.report))["levels"][0]["oriented_momenta"],
            json({{"elements", 17}, {"oblique_share", 0}}));
}

TEST(ReportJson, TellsBothWidthsOfOrientedMomenta) {
  ReportScene<2> scene(3);
  scene.result.momenta.back().axis = MomentumField<2>::kOriented;
  scene.result.momenta.back().width_mm = 6;
  scene.result.momenta.back().normal_width_mm = 3;
  const json momenta = json::parse(json_of(scene.report))["momenta"];
  EXPECT_EQ(momenta.back()["width_mm"], 6);
  EXPECT_EQ(momenta.back()["normal_width_mm"], 3);
  EXPECT_FALSE(momenta.front().contains("normal_width_mm"));
}

TEST(ReportJson, CarriesTheNotices) {
  ReportScene<2> scene(2);
  EXPECT_EQ(json::parse(json_of(scene.report))["notices"], json::array());
  scene.result.summary.notices = {"fixed image is 7 everywhere"};
  EXPECT_EQ(json::parse(json_of(scene.report))["notices"], json({"fixed image is 7 everywhere"}));
}

TEST(ReportJson, MeasuresDisplacementJacobianAndMomenta) {
  const ReportScene<2> scene(3);
  const json report = json::parse(json_of(scene.report));
  const double voxels = 12 * 16;
  EXPECT_NEAR(report["displacement_mm"]["mean"].get<double>(), 3, 1e-6);
  EXPECT_NEAR(report["displacement_mm"]["max"].get<double>(), 3, 1e-6);
  EXPECT_EQ(report["jacobian"]["min"], -0.5);
  EXPECT_EQ(report["jacobian"]["max"], 2.0);
  // The border counts for nothing; of the interior one voxel folds, one has log J = log 2, the others 0.
  const double interior = 10 * 14;
  EXPECT_NEAR(report["jacobian"]["share_not_positive"].get<double>(), 1 / interior, 1e-12);
  const double mean = std::log(2) / (interior - 1);
  EXPECT_NEAR(report["jacobian"]["sd_log"].get<double>(), std::sqrt(std::log(2) * mean - mean * mean), 1e-9);
  ASSERT_EQ(report["momenta"].size(), 2u);
  EXPECT_EQ(report["momenta"][0]["order"], 0);
  EXPECT_NEAR(report["momenta"][0]["active_share"].get<double>(), 1 / voxels, 1e-12);
  EXPECT_EQ(report["momenta"][1]["order"], 1);
  EXPECT_EQ(report["momenta"][1]["axis"], 0);
  EXPECT_EQ(report["momenta"][1]["active_share"], 0.0);
}

TEST(ReportJson, MeasuresLandmarksBeforeAndAfter) {
  ReportScene<3> scene(3);
  for (double error : {0.0, 1.0, 2.0, 4.0, 8.0}) scene.add_landmark({2, 5, 7}, error);
  const json errors = json::parse(json_of(scene.report))["landmark_error_mm"];
  EXPECT_FALSE(errors.contains("affine_start"));
  EXPECT_EQ(errors["after"]["n"], 5);
  EXPECT_NEAR(errors["after"]["mean"].get<double>(), 3, 1e-6);
  EXPECT_NEAR(errors["after"]["sd"].get<double>(), std::sqrt(8), 1e-6);
  EXPECT_NEAR(errors["after"]["median"].get<double>(), 2, 1e-6);
  EXPECT_NEAR(errors["after"]["p90"].get<double>(), 6.4, 1e-6);
  EXPECT_NEAR(errors["after"]["max"].get<double>(), 8, 1e-6);
  EXPECT_NEAR(errors["before"]["max"].get<double>(), std::hypot(8, 3), 1e-6);
}

TEST(ReportJson, TellsWhatTheAffineStartAloneReaches) {
  ReportScene<2> scene(3);
  scene.add_landmark({2, 5}, 0);  // its partner is 3 mm further along y
  scene.images.start.offset = {0, 2};
  const json errors = json::parse(json_of(scene.report))["landmark_error_mm"];
  EXPECT_NEAR(errors["before"]["mean"].get<double>(), 3, 1e-6);
  EXPECT_NEAR(errors["affine_start"]["mean"].get<double>(), 1, 1e-6);
}

TEST(ReportJson, MeasuresLandmarksThatTheFlowCarriedApartFromThoseThatStopped) {
  ReportScene<2> scene(3);
  for (int i = 0; i < 3; ++i) scene.add_landmark({2, 5}, 0);
  for (double error : {1.0, 3.0, 50.0})
    scene.result.moved_points.push_back({scene.report.moving_points[0] + Vector<2>(0, error), Matrix<2>::Identity()});
  scene.result.moved_points[2].ending = TrajectoryEnd::Escaping;
  const json report = json::parse(json_of(scene.report));
  EXPECT_EQ(report["landmark_error_mm"]["after_particles"]["n"], 2);
  EXPECT_NEAR(report["landmark_error_mm"]["after_particles"]["mean"].get<double>(), 2, 1e-6);
  EXPECT_EQ(report["landmark_particles_stopped"], 1);
  EXPECT_NEAR(report["landmark_error_mm"]["after"]["mean"].get<double>(), 0, 1e-6);
}

TEST(ReportJson, LeavesOutWhatIsNotKnown) {
  ReportScene<2> scene(3);
  scene.report.peak_memory_bytes = 0;
  scene.result.summary.hamiltonian_drift = -1;
  const json report = json::parse(json_of(scene.report));
  for (const char* name : {"peak_memory_bytes", "hamiltonian_drift", "landmark_error_mm"})
    EXPECT_FALSE(report.contains(name)) << name;
}

TEST(ReportJson, StaysJsonWithAnyTitleAndAnyNumber) {
  ReportScene<2> scene(3);
  scene.report.title = "quote \" and \xff\xfe bytes";
  scene.result.summary.similarity_after = std::numeric_limits<double>::quiet_NaN();
  const json report = json::parse(json_of(scene.report));
  EXPECT_THAT(report["title"].get<std::string>(), testing::StartsWith("quote \" and "));
  EXPECT_TRUE(report["similarity_value"]["after"].is_null());
}

TEST(ReportJson, RefusesUnequalNumbersOfLandmarks) {
  ReportScene<2> scene(3);
  scene.add_landmark({2, 5}, 0);
  scene.report.moving_points.clear();
  EXPECT_THROW(json_of(scene.report), InvalidInput);
  EXPECT_THROW(html_of(scene.report), InvalidInput);
}

}  // namespace
}  // namespace saltus::report
