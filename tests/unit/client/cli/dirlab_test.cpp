// Packs in the layout of DIR-Lab's, made here; the coordinates' oracle is arithmetic by hand.
#include "client/cli/command.h"
#include "client/cli/dirlab_pack.h"
#include "client/cli/dirlab_scores.h"
#include "core/support/errors.h"
#include "tests/support/captured_command_line.h"
#include "tests/support/temporary_folder.h"

#include <gmock/gmock.h>

#include <cmath>
#include <fstream>

namespace saltus::cli {
namespace {

using testing::HasSubstr;

class Dirlab : public testing::Test {
 protected:
  /// A pack with the names that its case has at DIR-Lab: pack folder, image suffix, name of the landmarks.
  void make_pack(int number, const std::string& pack, const std::string& suffix, const std::string& landmarks) {
    namespace fs = std::filesystem;
    fs::create_directories(folder / pack / "Images");
    fs::create_directories(folder / pack / "ExtremePhases");
    fs::create_directories(folder / pack / "Sampled4D");
    const std::string name = "case" + std::to_string(number);
    for (const std::string phase : {"T00", "T50"}) {
      std::ofstream(folder / pack / "Images" / (name + "_" + phase + suffix));
      // Beside them other phases and other landmarks, which must not be taken for these.
      std::ofstream(folder / pack / "Images" / (name + "_T10" + suffix));
      std::ofstream(folder / pack / "Sampled4D" / (name + "_4D-75_" + phase + ".txt"));
      std::ofstream points(folder / pack / "ExtremePhases" / (landmarks + phase + "_xyz.txt"));
      points << (phase == "T00" ? "1\t1\t1\n10 20 30\n" : "1 1 3\n\n13 24 30 \n");
    }
  }
  int run(const std::vector<std::string>& words) {
    const testing_support::CapturedRun run = testing_support::run_command_line_captured(words);
    out = run.out;
    error = run.err;
    return run.exit_code;
  }
  testing_support::TemporaryFolder folder;
  std::string out, error;
};

TEST_F(Dirlab, KnowsTheTenCases) {
  ASSERT_EQ(dirlab_cases().size(), 10u);
  double sum = 0;
  // In plane, as DIR-Lab's page of reference data has them, and many readers of its packs.
  const double spacings[] = {0.97, 1.16, 1.15, 1.13, 1.10, 0.97, 0.97, 0.97, 0.97, 0.97};
  const int slices[] = {94, 112, 104, 99, 106, 128, 136, 128, 128, 120};
  for (const DirlabCase& about : dirlab_cases()) {
    EXPECT_EQ(about.spacing[0], spacings[about.number - 1]) << about.number;
    EXPECT_EQ(about.spacing[1], spacings[about.number - 1]) << about.number;
    EXPECT_EQ(about.size[2], slices[about.number - 1]) << about.number;
    EXPECT_EQ(about.size[0], about.number <= 5 ? 256 : 512);
    EXPECT_EQ(about.spacing[2], 2.5);
    sum += about.initial_error_mm;
  }
  EXPECT_NEAR(sum / 10, 8.46, 0.005);  // the mean that the paper's table gives
}

TEST_F(Dirlab, FindsTheFilesOfEveryLayout) {
  make_pack(1, "Case1Pack", "_s.img", "Case1_300_");
  make_pack(2, "Case2Pack", "-ssm.img", "Case2_300_");
  make_pack(8, "Case8Deploy", ".img", "case8_dirLab300_");
  make_pack(10, "Case10Pack", ".img", "case10_dirLab300_");
  for (const auto& [number, image] :
       {std::pair{1, "case1_T00_s.img"}, {2, "case2_T00-ssm.img"}, {8, "case8_T00.img"}, {10, "case10_T00.img"}}) {
    const DirlabPaths paths = find_dirlab_case(folder.path(), number);
    EXPECT_EQ(paths.inhale.filename(), image);
    EXPECT_THAT(paths.exhale.filename().string(), HasSubstr("T50"));
    EXPECT_THAT(paths.inhale_points.filename().string(), HasSubstr("300_T00_xyz"));
    EXPECT_THAT(paths.exhale_points.filename().string(), HasSubstr("300_T50_xyz"));
  }
  EXPECT_THROW(find_dirlab_case(folder.path(), 3), FileError);
  make_pack(1, "copy", "_s.img", "Case1_300_");
  EXPECT_THROW(find_dirlab_case(folder.path(), 1), FileError);
}

TEST_F(Dirlab, ReadsVoxelsAndIndicesFromOne) {
  DirlabCase about{1, {3, 2, 2}, {0.5, 1, 2.5}, 0};
  const std::string bytes(
      "\x01\x00\x02\x00\xFF\xFF\x00\x10\x05\x00\x06\x00\x07\x00\x08\x00\x09\x00\x0A\x00\x0B\x00\x0C\x00", 24);
  const Volume<3> image = read_dirlab_image(folder.write("a.img", bytes), about);
  EXPECT_EQ(image.samples[0], 1);
  EXPECT_EQ(image.samples[2], -1);
  EXPECT_EQ(image.samples[3], 4096);  // x runs fastest: (0, 1, 0)
  EXPECT_EQ(image.grid.to_world({0, 0, 1}), Vector<3>(0, 0, 2.5));
  EXPECT_THROW(read_dirlab_image(folder.write("b.img", bytes + "x"), about), FileError);

  const auto points = read_dirlab_points(folder.write("p.txt", "1 1 1\n3\t2 2\r\n"), about);
  ASSERT_EQ(points.size(), 2u);
  EXPECT_EQ(points[0], Vector<3>(0, 0, 0));
  EXPECT_EQ(points[1], Vector<3>(1, 1, 2.5));
  for (const char* bad : {"0 1 1\n", "1 1 3\n", "1 1\n", "1 1 1 1\n", "a b c\n", ""})
    EXPECT_THROW(read_dirlab_points(folder.write("p.txt", bad), about), FileError) << bad;
}

TEST_F(Dirlab, ProvesTheCoordinatesBeforeAnythingElse) {
  make_pack(1, "Case1Pack", "_s.img", "Case1_300_");
  // (0, 0, 2) voxels of 2.5 mm are 5 mm, and (3, 4, 0) of 0.97 mm are 4.85: 4.925 in the mean, not 3.89.
  EXPECT_EQ(run({"dirlab", "--root", folder.path(), "--cases", "1", "--out", folder / "out"}), Usage);
  EXPECT_THAT(error, HasSubstr("not those of DIR-Lab's cases"));
  EXPECT_THAT(error, HasSubstr("(expected 3.89)"));
  EXPECT_FALSE(std::filesystem::exists(folder / "out"));
  EXPECT_EQ(run({"dirlab", "--root", folder.path(), "--cases", "1", "--only-check", "--initial-errors", "4.925"}), Done)
      << error;
  EXPECT_EQ(run({"dirlab", "--root", folder.path(), "--cases", "1", "--only-check", "--initial-errors", "1,2"}), Usage);
  EXPECT_EQ(run({"dirlab", "--root", folder.path(), "--cases", "2", "--only-check"}), JobFailed);
  for (const char* cases : {"0", "11", "3-1", "x", ""})
    EXPECT_EQ(run({"dirlab", "--root", folder.path(), "--cases", cases, "--only-check"}), Usage) << cases;
  // The images of this pack are empty, which is said before a daemon is started.
  EXPECT_EQ(
      run({"dirlab", "--root", folder.path(), "--cases", "1", "--initial-errors", "4.925", "--out", folder / "out"}),
      JobFailed);
  EXPECT_THAT(error, HasSubstr("256x256x94 voxels of two bytes"));
}

// Names as the ten packs have them; the errors by hand: 5 mm along z for the first landmark, 4 voxels along x for the
// second, which is the last voxel of its case: 256 and 512 are not taken for each other.
TEST_F(Dirlab, ProvesAllTenPacks) {
  std::string expected;
  for (const DirlabCase& about : dirlab_cases()) {
    const std::string number = std::to_string(about.number);
    const std::string suffix = about.number == 1 ? "_s.img" : about.number <= 5 ? "-ssm.img" : ".img";
    const std::string landmarks = about.number <= 5 ? "Case" + number + "_300_" : "case" + number + "_dirLab300_";
    const std::string pack = "Case" + number + (about.number == 8 ? "Deploy" : "Pack");
    make_pack(about.number, pack, suffix, landmarks);
    const auto points = folder / pack / "ExtremePhases" / landmarks;
    const auto [x, y, z] = about.size;
    std::ofstream(points.string() + "T00_xyz.txt") << "1 1 1\n" << x << ' ' << y << ' ' << z << '\n';
    std::ofstream(points.string() + "T50_xyz.txt") << "1 1 3\n" << x - 4 << ' ' << y << ' ' << z << '\n';
    expected += (expected.empty() ? "" : ",") + std::to_string((5 + 4 * about.spacing[0]) / 2);
  }
  EXPECT_EQ(run({"dirlab", "--root", folder.path(), "--only-check", "--initial-errors", expected}), Done) << error;
  EXPECT_THAT(error, HasSubstr("case10: 2 landmarks, before registration 4.44 mm"));
  EXPECT_EQ(run({"dirlab", "--root", folder.path(), "--only-check"}), Usage);
  EXPECT_THAT(error, testing::AllOf(HasSubstr("case01: 2 landmarks, before registration 4.44 mm (expected 3.89)"),
                                    HasSubstr("case10: 2 landmarks, before registration 4.44 mm (expected 7.30)")));
}

TEST_F(Dirlab, ReadsAVolumeOfTheLargeLayout) {
  const DirlabCase& about = dirlab_cases()[6];  // 512x512x136
  const auto file = folder.write("case7_T00.img", "");
  std::filesystem::resize_file(file, 2 * std::uintmax_t{512} * 512 * 136);
  std::fstream image(file, std::ios::in | std::ios::out | std::ios::binary);
  image.seekp(2 * ((135l * 512 + 510) * 512 + 3));
  image.write("\x34\x02", 2);
  image.close();
  const Volume<3> read = read_dirlab_image(file, about);
  EXPECT_EQ(read.samples[(135u * 512 + 510) * 512 + 3], 0x234);
  EXPECT_EQ(read.grid.to_world({3, 510, 135}), Vector<3>(3 * 0.97, 510 * 0.97, 135 * 2.5));
  EXPECT_THROW(read_dirlab_image(file, dirlab_cases()[5]), FileError);  // of case 6, which has fewer slices
}

TEST_F(Dirlab, SnapsToTheNearestVoxel) {
  ImageGrid<3> grid;
  grid.size = {10, 10, 10};
  grid.spacing = {1, 1, 2.5};
  VectorVolume<3> u(grid);
  std::fill_n(u.component(0), grid.voxels(), 1.4f);
  const LandmarkScores scores = score_landmarks(u, {{2, 3, 5}}, {{3, 3, 5}});
  EXPECT_NEAR(scores.raw[0], 0.4, 1e-6);
  EXPECT_NEAR(scores.snapped[0], 0, 1e-9);
}

TEST_F(Dirlab, TestsByRanks) {
  // All ten differences positive and different: W+ = 55, mean 27.5, variance 10 * 11 * 21 / 24 = 96.25.
  std::vector<double> a, b(10, 0.0);
  for (int i = 1; i <= 10; ++i) a.push_back(i);
  EXPECT_NEAR(signed_rank_test(a, b).z, 27.5 / std::sqrt(96.25), 1e-12);
  EXPECT_NEAR(signed_rank_test(a, b).p, 0.00506, 1e-5);
  EXPECT_NEAR(signed_rank_test(b, a).z, -27.5 / std::sqrt(96.25), 1e-12);
  EXPECT_EQ(signed_rank_test(b, b).p, 1);
  // Differences 1, 1, -1 and one that is 0: ranks 2 each, W+ = 4, mean 3, variance 3 * 4 * 7 / 24 - 24 / 48 = 3.
  EXPECT_NEAR(signed_rank_test({1, 1, 0, 5}, {0, 0, 1, 5}).z, 1 / std::sqrt(3.0), 1e-12);
  EXPECT_THROW(signed_rank_test({1}, {}), InvalidInput);
}

TEST_F(Dirlab, HasThePapersMeans) {
  std::map<std::string, double> means;
  for (int number = 1; number <= 10; ++number)
    for (const auto& [model, error] : paper_errors(number)) means[model] += error / 10;
  EXPECT_NEAR(means["gaussian"], 2.54, 0.0051);
  EXPECT_NEAR(means["wendland"], 2.54, 0.0051);
  EXPECT_NEAR(means["wendland1"], 2.49, 0.0051);
}

}  // namespace
}  // namespace saltus::cli
