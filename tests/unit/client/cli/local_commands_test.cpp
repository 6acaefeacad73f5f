#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "client/cli/command.h"
#include "client/cli/transform_folder.h"
#include "core/image_io/points_io.h"
#include "core/image_io/read_image.h"
#include "core/image_io/write_image.h"
#include "core/image_io/write_transform.h"
#include "core/support/errors.h"
#include "tests/support/captured_command_line.h"

namespace saltus::cli {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

/// phantom, points, warp and evaluate as a user runs them, in a folder of their own.
class LocalCommands : public testing::Test {
 protected:
  LocalCommands() : folder_(fs::path(testing::TempDir()) / ("saltus_local_commands_" + std::to_string(getpid()))) {
    fs::create_directories(folder_);
  }
  ~LocalCommands() override { fs::remove_all(folder_); }

  int run(const std::vector<std::string>& words) {
    const testing_support::CapturedRun run = testing_support::run_command_line_captured(words);
    out_ = run.out;
    error_ = run.err;
    return run.exit_code;
  }
  std::string at(const std::string& name) const { return (folder_ / name).string(); }

  /// A phantom in folder "p", and its truth as if a registration had found it in folder "t".
  void make_slip(const std::string& format = "mha") {
    ASSERT_EQ(run({"phantom", "slip", "--size", "48,40", "--noise", "0", "--format", format, "--out", at("p")}), Done)
        << error_;
    fs::create_directories(folder_ / "t");
    fs::copy_file(at("p/truth." + format), at("t/displacement." + format));
    fs::copy_file(at("p/inverse_truth." + format), at("t/inverse_displacement." + format));
  }

  fs::path folder_;
  std::string out_, error_;
};

TEST_F(LocalCommands, APhantomsTruthScoresPerfectly) {
  for (const char* format : {"mha", "nii.gz", "nrrd"}) {
    SCOPED_TRACE(format);
    const std::string suffix = std::string(".") + format;
    make_slip(format);
    ASSERT_EQ(run({"evaluate", "--transform", at("t"), "--truth", at("p/truth" + suffix), "--mask",
                   at("p/mask_valid" + suffix), "--mask", at("p/mask_near" + suffix), "--fixed-points",
                   at("p/fixed_points.csv"), "--moving-points", at("p/moving_points.csv"), "--fixed-labels",
                   at("p/fixed_labels" + suffix), "--moving-labels", at("p/moving_labels" + suffix), "--json"}),
              Done)
        << error_;
    const auto score = nlohmann::json::parse(out_);
    EXPECT_EQ(score.at("epe_mm").at("max"), 0);
    EXPECT_NEAR(score.at("epe_before_mm").at("mean").get<double>(), 3, 1e-6);
    // Six rows near the interface; of 48 columns two at the border and three that the motion takes there do not count.
    EXPECT_EQ(score.at("epe_mm").at("n"), 6 * (48 - 2 - 3));
    EXPECT_NEAR(score.at("tre_mm").at("median").get<double>(), 0, 1e-5);
    EXPECT_NEAR(score.at("tre_before_mm").at("mean").get<double>(), 3, 1e-6);
    // What comes from beyond the image has no label: three columns of 48.
    EXPECT_GT(score.at("dice").at("mean").get<double>(), 1 - 3.0 / 48);
    EXPECT_LT(score.at("dice_before").at("mean").get<double>(), 1 - 6.0 / 48);
    fs::remove_all(folder_ / "t");
  }
}

// A label map on a larger grid, with the same labels at the same places in the world, scores the same.
TEST_F(LocalCommands, LabelsMayHaveAGridOfTheirOwn) {
  make_slip();
  const Volume<2> labels = read_volume<2>(at("p/fixed_labels.mha"));
  ImageGrid<2> grid = labels.grid;
  constexpr int margin = 4;
  for (int axis = 0; axis < 2; ++axis) grid.size[axis] += 2 * margin;
  grid.origin = labels.grid.to_world(Vector<2>::Constant(-margin));
  Volume<2> larger(grid);
  for (int y = 0; y < labels.grid.size[1]; ++y)
    for (int x = 0; x < labels.grid.size[0]; ++x)
      larger.samples[(y + margin) * grid.size[0] + x + margin] = labels.samples[y * labels.grid.size[0] + x];
  write_volume<2>(at("larger.mha"), larger);
  nlohmann::json scores[2];
  for (const bool is_larger : {false, true}) {
    ASSERT_EQ(run({"evaluate", "--transform", at("t"), "--fixed-labels",
                   is_larger ? at("larger.mha") : at("p/fixed_labels.mha"), "--moving-labels",
                   at("p/moving_labels.mha"), "--json"}),
              Done)
        << error_;
    scores[is_larger] = nlohmann::json::parse(out_);
  }
  EXPECT_EQ(scores[0].at("dice"), scores[1].at("dice"));
  EXPECT_EQ(scores[0].at("dice_before"), scores[1].at("dice_before"));
}

TEST_F(LocalCommands, PointsGoThereAndBack) {
  make_slip();
  ASSERT_EQ(run({"points", "--transform", at("t"), "--in", at("p/fixed_points.csv"), "--out", at("q.csv")}), Done);
  ASSERT_EQ(run({"points", "--transform", at("t"), "--in", at("q.csv"), "--out", at("back.csv"), "--inverse"}), Done);
  const auto fixed = read_points<2>(at("p/fixed_points.csv")), moving = read_points<2>(at("p/moving_points.csv"));
  const auto moved = read_points<2>(at("q.csv")), back = read_points<2>(at("back.csv"));
  ASSERT_EQ(moved.size(), fixed.size());
  for (std::size_t i = 0; i < fixed.size(); ++i) {
    if (std::abs(fixed[i][1] - 19.5) < 1) continue;  // the field is interpolated across the jump there
    EXPECT_LT((moved[i] - moving[i]).norm(), 1e-5);
    EXPECT_LT((back[i] - fixed[i]).norm(), 1e-5);
  }
}

// The oracle is the same field as an image.
TEST_F(LocalCommands, TakeTheTransformOfItkWhenOnlyThatIsThere) {
  make_slip();
  ASSERT_EQ(run({"points", "--transform", at("t"), "--in", at("p/fixed_points.csv"), "--out", at("a.csv")}), Done);
  ASSERT_EQ(run({"warp", "--transform", at("t"), "--in", at("p/moving.mha"), "--out", at("a.mha")}), Done);
  fs::create_directories(folder_ / "h5");
  write_transform(folder_ / "h5/transform.h5", read_vector_volume<2>(at("t/displacement.mha")));
  for (const std::string& transform : {at("h5"), at("h5/transform.h5")}) {
    ASSERT_EQ(run({"points", "--transform", transform, "--in", at("p/fixed_points.csv"), "--out", at("b.csv")}), Done)
        << error_;
    ASSERT_EQ(run({"warp", "--transform", transform, "--in", at("p/moving.mha"), "--out", at("b.mha")}), Done)
        << error_;
    EXPECT_EQ(read_points<2>(at("b.csv")), read_points<2>(at("a.csv")));
    EXPECT_EQ(read_volume<2>(at("b.mha")).samples, read_volume<2>(at("a.mha")).samples);
  }
  EXPECT_EQ(run({"evaluate", "--transform", at("h5"), "--truth", at("p/truth.mha"), "--json"}), Done) << error_;
  EXPECT_EQ(nlohmann::json::parse(out_).at("epe_mm").at("max"), 0);
  EXPECT_EQ(run({"points", "--transform", at("h5"), "--in", at("a.csv"), "--out", at("b.csv"), "--inverse"}),
            JobFailed);
  EXPECT_THAT(error_, HasSubstr("holds no inverse_displacement"));
}

TEST_F(LocalCommands, WarpBringsMovingToFixed) {
  make_slip();
  for (const char* interpolation : {"linear", "nearest", "bspline"}) {
    ASSERT_EQ(run({"warp", "--transform", at("t"), "--in", at("p/moving.mha"), "--out", at("w.mha"), "--interpolation",
                   interpolation}),
              Done);
    const auto warped = read_volume<2>(at("w.mha")), fixed = read_volume<2>(at("p/fixed.mha"));
    // The motion is 3 pixels, so every interpolation hits samples, within the image.
    for (int y = 0; y < 40; ++y)
      for (int x = 3; x < 45; ++x)
        EXPECT_NEAR(warped.samples[48 * y + x], fixed.samples[48 * y + x], 1e-3) << interpolation << x << ' ' << y;
  }
  ASSERT_EQ(run({"warp", "--transform", at("t"), "--in", at("p/fixed.mha"), "--out", at("w.mha"), "--inverse"}), Done);
  const auto warped = read_volume<2>(at("w.mha")), moving = read_volume<2>(at("p/moving.mha"));
  EXPECT_NEAR(warped.samples[48 * 10 + 20], moving.samples[48 * 10 + 20], 1e-3);
}

TEST_F(LocalCommands, PhantomDescribesItself) {
  ASSERT_EQ(run({"phantom", "thorax", "--size", "48,40,40", "--spacing", "6", "--seed", "9", "--out", at("th")}), Done)
      << error_;
  std::ifstream in(at("th/phantom.json"));
  const auto json = nlohmann::json::parse(in);
  EXPECT_EQ(json.at("kind"), "thorax");
  EXPECT_EQ(json.at("seed"), 9);
  EXPECT_EQ(json.at("spacing_mm"), nlohmann::json({6.0, 6.0, 6.0}));
  EXPECT_EQ(json.at("landmarks"), read_points<3>(at("th/fixed_points.csv")).size());
  EXPECT_EQ(image_dimension(at("th/fixed.mha")), 3);
}

TEST_F(LocalCommands, WrongInputIsSaidWithTheWayOut) {
  make_slip();
  auto expect_refused = [this](const std::vector<std::string>& words, const std::string& reason) {
    EXPECT_EQ(run(words), Usage) << reason;
    EXPECT_THAT(error_, HasSubstr(reason));
  };
  expect_refused({"phantom", "blob", "--out", at("x")}, "rectangle, wheel, slip, thorax, smooth");
  expect_refused({"phantom", "wheel", "--slip", "3", "--out", at("x")}, "--slip has no meaning for the phantom wheel");
  expect_refused({"phantom", "slip", "--radius", "9", "--out", at("x")}, "--radius has no meaning");
  expect_refused({"phantom", "slip", "--size", "9,9", "--dimension", "3", "--out", at("x")}, "--dimension is 3");
  expect_refused({"phantom", "slip", "--spacing", "1,2,3", "--out", at("x")}, "--spacing has 3 numbers");
  expect_refused({"phantom", "slip", "--format", "png", "--out", at("x")}, "--format is png");
  expect_refused({"phantom", "slip", "--noise", "-1", "--out", at("x")}, "noise is -1");
  EXPECT_FALSE(fs::exists(at("x")));
  expect_refused({"evaluate", "--transform", at("t"), "--fixed-points", at("p/fixed_points.csv")},
                 "--moving-points; both are needed");
  expect_refused({"evaluate", "--transform", at("t"), "--mask", at("p/mask_near.mha")}, "without --truth");
  expect_refused(
      {"warp", "--transform", at("t"), "--in", at("p/moving.mha"), "--out", at("w.mha"), "--interpolation", "cubic"},
      "linear, nearest, bspline");
  expect_refused(
      {"points", "--transform", at("p/truth.mha"), "--in", at("p/fixed_points.csv"), "--out", at("q.csv"), "--inverse"},
      "--inverse needs the folder");
  EXPECT_EQ(run({"evaluate", "--transform", at("p")}), JobFailed);
  EXPECT_THAT(error_, HasSubstr("holds no displacement"));
}

TEST_F(LocalCommands, DisplacementFilesAreFoundInEveryFormat) {
  EXPECT_THROW(displacement_file(folder_, TransformDirection::Forward), FileError);
  std::ofstream(at("displacement.nrrd")) << "x";
  std::ofstream(at("inverse_displacement.nii.gz")) << "x";
  EXPECT_EQ(displacement_file(folder_, TransformDirection::Forward), folder_ / "displacement.nrrd");
  EXPECT_EQ(displacement_file(folder_, TransformDirection::Inverse), folder_ / "inverse_displacement.nii.gz");
}

// Results of two registrations, of which the first in some order need not be the last.
TEST_F(LocalCommands, RefuseAFolderWithTheDisplacementInTwoFormats) {
  make_slip();
  make_slip("nii.gz");
  const std::string both = "displacement.mha and displacement.nii.gz; name one of them with --transform";
  const std::vector<std::string> commands[] = {
      {"points", "--transform", at("t"), "--in", at("p/fixed_points.csv"), "--out", at("out.csv")},
      {"warp", "--transform", at("t"), "--in", at("p/moving.mha"), "--out", at("out.mha")},
      {"evaluate", "--transform", at("t"), "--truth", at("p/truth.mha")}};
  for (const auto& command : commands) {
    EXPECT_EQ(run(command), Usage);
    EXPECT_THAT(error_, HasSubstr(both));
    EXPECT_THAT(error_, HasSubstr("or remove the old one"));
  }
  EXPECT_FALSE(fs::exists(at("out.csv")) || fs::exists(at("out.mha")));
  EXPECT_EQ(
      run({"points", "--transform", at("t"), "--in", at("p/fixed_points.csv"), "--out", at("out.csv"), "--inverse"}),
      Usage);
  EXPECT_THAT(error_, HasSubstr("holds inverse_displacement.mha and inverse_displacement.nii.gz"));

  EXPECT_EQ(run({"points", "--transform", at("t/displacement.nii.gz"), "--in", at("p/fixed_points.csv"), "--out",
                 at("out.csv")}),
            Done)
      << error_;
  fs::remove(at("t/displacement.mha"));
  EXPECT_EQ(run(commands[0]), Done) << error_;
}

TEST_F(LocalCommands, CarriesLandmarksOfOtherAxesAndUnits) {
  make_slip();
  const auto points = read_points<2>(at("p/fixed_points.csv"));
  ASSERT_EQ(run({"points", "--transform", at("t"), "--in", at("p/fixed_points.csv"), "--out", at("moved.csv")}), Done);
  const auto expected = read_points<2>(at("moved.csv"));

  // The phantom's grid begins at the origin, so RAS landmarks lie outside of it, and indices are its mm.
  auto ras = points;
  for (Vector<2>& point : ras) point = -point;
  write_points(folder_ / "ras.csv", ras);
  EXPECT_EQ(run({"points", "--transform", at("t"), "--in", at("ras.csv"), "--out", at("out.csv")}), Usage);
  EXPECT_THAT(error_, HasSubstr("--points-space ras"));
  EXPECT_FALSE(fs::exists(at("out.csv")));
  ASSERT_EQ(run({"points", "--transform", at("t"), "--in", at("ras.csv"), "--points-space", "ras", "--out",
                 at("out.csv"), "--json"}),
            Done)
      << error_;
  EXPECT_EQ(nlohmann::json::parse(out_)["points"], points.size());
  for (const char* command : {"points", "evaluate"}) {
    const bool is_evaluate = command == std::string("evaluate");
    std::vector<std::string> words{command, "--transform", at("t"), "--points-space", "ras"};
    const std::vector<std::string> lps =
        is_evaluate ? std::vector<std::string>{"--fixed-points", at("p/fixed_points.csv"), "--moving-points",
                                               at("p/moving_points.csv")}
                    : std::vector<std::string>{"--in", at("p/fixed_points.csv"), "--out", at("lps.csv")};
    words.insert(words.end(), lps.begin(), lps.end());
    EXPECT_EQ(run(words), Usage);
    EXPECT_THAT(error_, HasSubstr("leave --points-space ras out"));
  }
  const auto moved = read_points<2>(at("out.csv"));
  for (std::size_t i = 0; i < points.size(); ++i) EXPECT_LT((moved[i] + expected[i]).norm(), 1e-9);

  ASSERT_EQ(run({"points", "--transform", at("t"), "--in", at("p/fixed_points.csv"), "--points-unit", "voxel", "--out",
                 at("out.csv")}),
            Done)
      << error_;
  EXPECT_EQ(
      run({"evaluate", "--transform", at("t"), "--fixed-points", at("ras.csv"), "--moving-points", at("ras.csv")}),
      Usage);
  EXPECT_THAT(error_, HasSubstr("--points-space ras"));
}

TEST_F(LocalCommands, SaysThatPointsSeemToGoTheOtherWay) {
  make_slip();
  // The moving image lies elsewhere, and the landmarks in it.
  auto inverse = read_vector_volume<2>(at("t/inverse_displacement.mha"));
  inverse.grid.origin = {500, 500};
  write_vector_volume(at("t/inverse_displacement.mha"), inverse);
  write_points<2>(folder_ / "moving.csv", {{510, 510}, {520, 515}});
  EXPECT_EQ(run({"points", "--transform", at("t"), "--in", at("moving.csv"), "--out", at("out.csv")}), Usage);
  EXPECT_THAT(error_, HasSubstr("add --inverse"));
  EXPECT_EQ(run({"points", "--transform", at("t"), "--in", at("moving.csv"), "--out", at("out.csv"), "--inverse"}),
            Done)
      << error_;
  EXPECT_EQ(run({"points", "--transform", at("t"), "--in", at("moving.csv"), "--out", at("o.csv"), "--allow-outside"}),
            Done)
      << error_;
}

}  // namespace
}  // namespace saltus::cli
