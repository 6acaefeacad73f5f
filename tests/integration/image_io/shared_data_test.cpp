// Reads every image of the shared test data, which the repository does not contain.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <numeric>

#include "core/image_io/points_io.h"
#include "core/image_io/read_image.h"

namespace saltus {
namespace {

const std::filesystem::path data = SALTUS_SHARED_DATA;

class SharedData : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!std::filesystem::is_directory(data)) GTEST_SKIP() << "no shared test data in " << data;
  }
};

TEST_F(SharedData, EveryImageAndPointFileIsRead) {
  int images = 0, fields = 0, points = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(data)) {
    const std::string name = entry.path().filename().string();
    SCOPED_TRACE(entry.path());
    if (name.ends_with(".csv")) {
      EXPECT_GE(read_points<3>(entry.path()).size(), 20u);
      ++points;
    } else if (name.ends_with("_truth.mha")) {
      EXPECT_EQ(read_vector_volume<2>(entry.path()).samples.size(), 2 * read_grid<2>(entry.path()).voxels());
      ++fields;
    } else if (entry.is_regular_file() && !name.ends_with(".md")) {
      std::vector<float> samples;
      if (image_dimension(entry.path()) == 2) {
        samples = read_volume<2>(entry.path()).samples;
      } else {
        samples = read_volume<3>(entry.path()).samples;
      }
      const auto [low, high] = std::minmax_element(samples.begin(), samples.end());
      EXPECT_LT(*low, *high);
      ++images;
    }
  }
  EXPECT_GT(images, 10);
  EXPECT_GT(fields, 0);
  EXPECT_GT(points, 10);
}

TEST_F(SharedData, TrueFieldOfThePaperHasItsJumpBetweenRows39And40) {
  // data/README.md: u_x = -5 in rows 0-39, +5 below.
  const auto truth = read_vector_volume<2>(data / "paper2d/toy_truth.mha");
  EXPECT_EQ(truth.grid.size, (Index<2>{80, 80}));
  EXPECT_EQ(truth.component(0)[39 * 80 + 40], -5);
  EXPECT_EQ(truth.component(0)[40 * 80 + 40], 5);
  EXPECT_EQ(truth.component(1)[40 * 80 + 40], 0);
  EXPECT_EQ(read_grid<2>(data / "paper2d/Toy_Reference_gra.png"), truth.grid);
}

TEST_F(SharedData, LandmarksLieInsideTheirImage) {
  for (const char* subject : {"subject_a", "subject_b"}) {
    const auto grid = read_grid<3>(data / "liver_mri" / subject / "fixed.mha");
    EXPECT_NEAR(grid.spacing[0], subject[8] == 'a' ? 1.4 : 1.3, 0.1);
    for (const Vector<3>& point : read_points<3>(data / "liver_mri" / subject / "fixed_liver.csv")) {
      const Vector<3> index = grid.to_index(point);
      for (int axis = 0; axis < 3; ++axis) {
        EXPECT_GE(index[axis], 0);
        EXPECT_LE(index[axis], grid.size[axis] - 1);
      }
    }
  }
}

}  // namespace
}  // namespace saltus
