#include "client/cli/input_check.h"

#include "core/image_io/points_io.h"
#include "core/image_io/write_image.h"
#include "core/support/errors.h"
#include "tests/support/temporary_folder.h"

#include <gmock/gmock.h>

namespace saltus::cli {
namespace {

using testing::HasSubstr;
using testing_support::TemporaryFolder;

ImageGrid<3> grid(const Vector<3>& origin, double spacing = 1) {
  ImageGrid<3> grid;
  grid.size = {40, 30, 20};
  grid.spacing.setConstant(spacing);
  grid.origin = origin;
  return grid;
}

TEST(InputCheck, FindsSpacingsThatDifferTenfold) {
  EXPECT_EQ(spacing_suspicion(grid({0, 0, 0}, 1), grid({0, 0, 0}, 5)), "");
  EXPECT_THAT(spacing_suspicion(grid({0, 0, 0}, 1), grid({0, 0, 0}, 10)), HasSubstr("10 x 10 x 10 mm"));
  EXPECT_THAT(spacing_suspicion(grid({0, 0, 0}, 1), grid({0, 0, 0}, 0.05)), HasSubstr("ten times"));
  ImageGrid<3> thick = grid({0, 0, 0});
  thick.spacing[2] = 12;  // thick slices are no mistake
  EXPECT_EQ(spacing_suspicion(grid({0, 0, 0}, 1), thick), "");
}

TEST(InputCheck, FindsImagesThatDoNotOverlap) {
  EXPECT_EQ(overlap_suspicion(grid({0, 0, 0}), grid({20, 0, 0})), "");
  const std::string apart = overlap_suspicion(grid({0, 0, 0}), grid({0, 0, 500}));
  EXPECT_THAT(apart, HasSubstr("z from 500 to 519 mm"));
  EXPECT_THAT(apart, HasSubstr("--affine rigid"));
  EXPECT_THAT(apart, testing::Not(HasSubstr("RAS")));
  // x and y of the moving image run the other way.
  EXPECT_THAT(overlap_suspicion(grid({100, 50, 0}), grid({-139, -79, 0})), HasSubstr("RAS"));
}

TEST(InputCheck, SaysWhatWouldPutThePointsInTheirImage) {
  const ImageGrid<3> here = grid({100, 200, 300}), there = grid({-500, 0, 0});
  const PointsPlace<3> place{"--fixed-points", "fixed image", here, there, "exchange them"};
  const std::vector<Vector<3>> right{{110, 210, 310}, {120, 205, 305}, {900, 0, 0}};
  EXPECT_EQ(points_suspicion(right, place), "");  // one of them may lie outside
  EXPECT_THAT(points_suspicion<3>({{-110, -210, 310}, {-120, -205, 305}}, place), HasSubstr("--points-space ras"));
  EXPECT_THAT(points_suspicion<3>({{3, 4, 5}, {30, 20, 10}}, place), HasSubstr("--points-unit voxel"));
  EXPECT_THAT(points_suspicion<3>({{-490, 4, 5}, {-480, 20, 10}}, place), HasSubstr("exchange them"));
  const std::string lost = points_suspicion<3>({{9000, 4, 5}, {110, 210, 310}, {9000, 0, 0}}, place);
  EXPECT_THAT(lost, HasSubstr("3 points, of which 1 lie in the fixed image"));
  EXPECT_THAT(lost, HasSubstr("x from 100 to 139"));
}

TEST(InputCheck, SaysWhichOptionOfThePointsIsWrong) {
  const ImageGrid<3> here = grid({100, 200, 300});
  PointsPlace<3> place{"--fixed-points", "fixed image", here};
  // All points as they are after reading: taken from RAS to LPS, or from indices to mm.
  place.format.space = "ras";
  const std::string axes = points_suspicion<3>({{-110, -210, 310}, {-120, -205, 305}}, place);
  EXPECT_THAT(axes, HasSubstr("they seem to be LPS: leave --points-space ras out"));
  EXPECT_THAT(axes, testing::Not(HasSubstr("add --points-space")));
  EXPECT_THAT(points_suspicion<3>({{-3, -4, 5}, {-30, -20, 10}}, place),
              HasSubstr("give --points-unit voxel in place of --points-space ras"));
  EXPECT_THAT(points_suspicion<3>({{9000, 4, 5}}, place), HasSubstr("world mm (RAS)"));

  place.format = {.space = "lps", .unit = "voxel"};
  EXPECT_THAT(points_suspicion<3>({here.to_world({110, 210, 310})}, place), HasSubstr("leave --points-unit voxel out"));
  const std::string lost = points_suspicion<3>({{9000, 4, 5}}, place);
  EXPECT_THAT(lost, HasSubstr("voxel indices of that image, which has 40"));
  EXPECT_THAT(lost, testing::Not(HasSubstr("add --points")));
}

/// A pair whose moving image lies elsewhere, with landmarks.
class JobCheck : public testing::Test {
 protected:
  JobCheck() {
    write_volume(folder / "fixed.mha", Volume<3>(grid({100, 200, 300}), 1));
    write_volume(folder / "moving.mha", Volume<3>(grid({105, 200, 300}), 1));
    job.fixed = folder / "fixed.mha";
    job.moving = folder / "moving.mha";
  }
  std::string refusal() const {
    try {
      check_inputs(job);
    } catch (const InvalidInput& error) {
      return error.what();
    }
    return "";
  }
  void give_points(const std::vector<Vector<3>>& fixed, const std::vector<Vector<3>>& moving) {
    write_points(folder / "p.csv", fixed);
    write_points(folder / "q.csv", moving);
    job.fixed_points = folder / "p.csv";
    job.moving_points = folder / "q.csv";
  }

  TemporaryFolder folder;
  JobOptions job;
};

TEST_F(JobCheck, RefusesAndLetsPassWhatIsAllowed) {
  EXPECT_EQ(refusal(), "");
  give_points({{-110, -210, 310}}, {{-112, -210, 310}});
  EXPECT_THAT(refusal(), HasSubstr("--points-space ras. If it is meant so, add --allow points."));
  job.points_format.space = "ras";
  EXPECT_EQ(refusal(), "");
  give_points({{110, 210, 310}}, {{112, 210, 310}});
  EXPECT_THAT(refusal(), HasSubstr("leave --points-space ras out. If it is meant so, add --allow points."));
  give_points({{-110, -210, 310}}, {{-112, -210, 310}});
  job.points_format.space = "lps";
  job.allowed = {"points"};
  EXPECT_EQ(refusal(), "");
  job.allowed = {"everything"};
  EXPECT_THAT(refusal(), HasSubstr("--allow is everything"));
}

TEST_F(JobCheck, TakesVoxelsOfEachImage) {
  give_points({{10, 10, 10}}, {{7, 10, 10}});
  EXPECT_THAT(refusal(), HasSubstr("--points-unit voxel"));
  job.points_format.unit = "voxel";
  EXPECT_EQ(refusal(), "");
  const auto there = read_points_as<3>(job.points_format, job.moving_points, grid({105, 200, 300}));
  EXPECT_EQ(there.front(), Vector<3>(112, 210, 310));
  job.points_format.space = "ras";
  EXPECT_THAT(refusal(), HasSubstr("voxel indices have no world axes"));
}

TEST_F(JobCheck, RefusesImagesOfDifferentDimensions) {
  ImageGrid<2> flat;
  flat.size = {8, 8};
  write_volume(folder / "moving.mha", Volume<2>(flat, 1));
  EXPECT_THAT(refusal(), HasSubstr("--fixed has 3 dimensions and --moving 2"));
}

TEST_F(JobCheck, AllowsImagesApartWithAnAffineStart) {
  write_volume(folder / "moving.mha", Volume<3>(grid({-900, 200, 300}), 1));
  EXPECT_THAT(refusal(), HasSubstr("hardly lie in the same place"));
  job.affine = "rigid";
  EXPECT_EQ(refusal(), "");
  job.affine = "none";
  job.allowed = {"overlap"};
  EXPECT_EQ(refusal(), "");
}

TEST_F(JobCheck, LeavesWhatCannotBeReadToTheWorker) {
  folder.write("fixed.mha", "no image");
  EXPECT_EQ(refusal(), "");
}

}  // namespace
}  // namespace saltus::cli
