#include "server/worker/registration_job.h"

#include "core/image_io/points_io.h"
#include "core/image_io/read_image.h"
#include "core/image_io/write_image.h"
#include "tests/support/blob_pair.h"
#include "tests/support/temporary_folder.h"

#include <gmock/gmock.h>

#include <cmath>
#include <limits>

namespace saltus::worker {
namespace {

using testing::Contains;
using testing::HasSubstr;
using testing::IsSupersetOf;
using testing_support::blob_scene;

constexpr int extent = 64;
constexpr double shift_mm = 3;

/// A pair with a known displacement, as a task that takes a second.
class RegistrationJobTest : public testing::Test {
 protected:
  void SetUp() override {
    std::filesystem::create_directory(results);
    write_volume(task.fixed, blob_scene(extent, 0));
    write_volume(task.moving, blob_scene(extent, shift_mm));
  }

  std::vector<std::string> run() {
    return run_registration_task(task, results, [this](TaskStage stage, const Progress& progress) {
      if (stages.empty() || stages.back() != stage) stages.push_back(stage);
      if (stage == TaskStage::Optimising && progress.level > 0) ++evaluations;
      return stop_after_evaluations >= 0 && evaluations > stop_after_evaluations ? ProgressAnswer::Stop
                                                                                 : ProgressAnswer::Continue;
    });
  }
  /// Runs, expects a failure and returns "REASON: message".
  std::string failure() {
    try {
      run();
    } catch (const TaskFailure& error) {
      const std::string text = error.reason() + ": " + error.what();
      EXPECT_EQ(text.find(folder.path().string()), std::string::npos) << "tells a folder of the server: " << text;
      return text;
    }
    return "no failure";
  }

  testing_support::TemporaryFolder folder;
  const std::filesystem::path results = folder / "results";
  RegistrationTask task = [this] {
    RegistrationTask made;
    made.fixed = folder / "fixed.mha";
    made.moving = folder / "moving.mha";
    made.model = "gaussian";
    made.similarity = "ssd";
    made.preset = "fast";
    made.output_format = "mha";
    made.settings = {{"max_iterations", "30"}, {"regularisation", "0.0001"}};
    return made;
  }();
  std::vector<TaskStage> stages;
  int evaluations = 0;
  int stop_after_evaluations = -1;
};

TEST_F(RegistrationJobTest, WritesEveryArtefactAndReportsItsStages) {
  const auto names = run();
  EXPECT_THAT(names, IsSupersetOf({"displacement.mha", "inverse_displacement.mha", "warped.mha", "jacobian.mha",
                                   "momentum_1_order0.mha", "transform.h5", "interface.csv", "interface.vtp",
                                   "report.json", "report.html"}));
  for (const std::string& name : names) EXPECT_GT(std::filesystem::file_size(results / name), 0u) << name;
  EXPECT_EQ(static_cast<std::size_t>(std::distance(std::filesystem::directory_iterator(results), {})), names.size());
  EXPECT_EQ(stages, (std::vector{TaskStage::Validating, TaskStage::Optimising, TaskStage::Writing}));
  EXPECT_GT(evaluations, 0);
}

// Oracle: the scene was moved by (shift, 0) mm in the world.
TEST_F(RegistrationJobTest, FindsTheDisplacementInWorldMillimetres) {
  run();
  const auto field = read_vector_volume<2>(results / "displacement.mha");
  EXPECT_TRUE(field.grid == blob_scene(extent, 0).grid);
  const std::size_t middle = static_cast<std::size_t>(extent) * (extent / 2) + extent / 2;
  EXPECT_NEAR(field.component(0)[middle], shift_mm, 0.1 * shift_mm);
  EXPECT_NEAR(field.component(1)[middle], 0, 0.1 * shift_mm);
}

TEST_F(RegistrationJobTest, DeliversACropWhereItIsInTheWorld) {
  task.crop = {{4, 6}, {28, 30}};
  run();
  const auto whole = blob_scene(extent, 0).grid;
  const auto part = read_grid<2>(results / "displacement.mha");
  EXPECT_EQ(part.size, (Index<2>{24, 24}));
  EXPECT_LT((part.origin - whole.to_world(Vector<2>(4, 6))).norm(), 1e-9);
}

TEST_F(RegistrationJobTest, TakesMasksLandmarksAnAffineStartAndAWindow) {
  Volume<2> mask(blob_scene(extent, 0).grid, 1);
  mask.grid.origin[0] += 1e-4;  // as a format that rounds would give it
  write_labels(folder / "mask.mha", mask);
  task.fixed_mask = task.moving_mask = folder / "mask.mha";
  const std::vector<Vector<2>> points{Vector<2>(0, 50), Vector<2>(5, 60)};
  write_points<2>(folder / "p.csv", points);
  write_points<2>(folder / "q.csv", {points[0] + Vector<2>(shift_mm, 0), points[1] + Vector<2>(shift_mm, 0)});
  task.fixed_points = folder / "p.csv";
  task.moving_points = folder / "q.csv";
  task.affine = AffineStart::Rigid;
  task.intensity_window = {5, 90};
  run();
  const auto field = read_vector_volume<2>(results / "displacement.mha");
  EXPECT_NEAR(field.component(0)[extent * (extent / 2) + extent / 2], shift_mm, 0.1 * shift_mm);
  EXPECT_THAT(testing_support::content_of(results / "report.json"), HasSubstr("landmark"));
}

TEST_F(RegistrationJobTest, StopsWhenTheObserverSaysSo) {
  stop_after_evaluations = 2;
  EXPECT_THROW(run(), TaskStopped);
  EXPECT_TRUE(std::filesystem::is_empty(results));
}

TEST_F(RegistrationJobTest, RefusesFilesThatAreNoImages) {
  folder.write("moving.mha", "this is no image");
  EXPECT_THAT(failure(), testing::AllOf(HasSubstr("INPUT_UNREADABLE: "), HasSubstr("moving.mha")));
}

TEST_F(RegistrationJobTest, RefusesImagesOfDifferentDimension) {
  ImageGrid<3> grid;
  grid.size = {8, 8, 8};
  write_volume(task.moving, Volume<3>(grid, 1));
  EXPECT_THAT(failure(), HasSubstr("GEOMETRY_MISMATCH: "));
}

TEST_F(RegistrationJobTest, RefusesAMaskOnAnotherGrid) {
  Volume<2> mask(blob_scene(extent, 0).grid, 1);
  mask.grid.origin[0] += 5;
  write_labels(folder / "mask.mha", mask);
  task.fixed_mask = folder / "mask.mha";
  EXPECT_THAT(failure(), testing::AllOf(HasSubstr("GEOMETRY_MISMATCH: "), HasSubstr("fixed mask")));
}

TEST_F(RegistrationJobTest, RefusesLandmarksThatDoNotPair) {
  write_points<2>(folder / "p.csv", {Vector<2>(0, 0)});
  write_points<2>(folder / "q.csv", {Vector<2>(0, 0), Vector<2>(1, 1)});
  task.fixed_points = folder / "p.csv";
  task.moving_points = folder / "q.csv";
  EXPECT_THAT(failure(), testing::AllOf(HasSubstr("GEOMETRY_MISMATCH: "), HasSubstr("1 fixed and 2 moving")));
}

TEST_F(RegistrationJobTest, CountsAndPlacesWhatIsNotFinite) {
  Volume<2> image = blob_scene(extent, 0);
  image.samples[2 * extent + 7] = std::numeric_limits<float>::quiet_NaN();
  image.samples[2 * extent + 8] = std::numeric_limits<float>::infinity();
  write_volume(task.fixed, image);
  EXPECT_THAT(failure(),
              testing::AllOf(HasSubstr("NON_FINITE_INPUT: "), HasSubstr("fixed image has 2 "), HasSubstr("(7, 2)")));
}

TEST_F(RegistrationJobTest, RefusesOptionsThatItDoesNotKnow) {
  task.settings["speed"] = "11";
  EXPECT_THAT(failure(), testing::AllOf(HasSubstr("INVALID_OPTIONS: "), HasSubstr("speed")));
}

TEST_F(RegistrationJobTest, RefusesACropThatLeavesTheImage) {
  task.crop = {{4, 6}, {28, 300}};
  EXPECT_THAT(failure(), HasSubstr("INVALID_OPTIONS: "));
  task.crop = {{0, 0, 0}, {8, 8, 8}};
  EXPECT_THAT(failure(), HasSubstr("INVALID_OPTIONS: "));
}

}  // namespace
}  // namespace saltus::worker
