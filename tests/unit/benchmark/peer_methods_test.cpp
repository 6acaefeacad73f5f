// Programs that are not ours, and the files they are given. Real ones are run where they are installed.
#include "tests/benchmark/peers/methods.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <iterator>
#include <stdexcept>

#include "core/image_io/read_image.h"
#include "core/image_io/write_image.h"
#include "tests/support/temporary_folder.h"

namespace saltus::benchmark {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

class PeerMethods : public ::testing::Test {
 protected:
  testing_support::TemporaryFolder folder_;
  std::filesystem::path work() const {
    std::filesystem::create_directories(folder_.path() / "work");
    return folder_.path() / "work";
  }

  /// 2-D with a slip of 4 px; 3-D with smooth motion and spacing and direction of its own.
  PeerPair pair_2d() const {
    PhantomOptions options = default_phantom_options(PhantomKind::Slip);
    options.size = {64, 56, 1};
    options.slip_mm = 4;
    return phantom_pair("slip", options, SimilarityType::Ssd, 6, folder_.path() / "images");
  }
  PeerPair pair_3d(bool has_turned_axes) const {
    PhantomOptions options = default_phantom_options(PhantomKind::Smooth, 3);
    options.size = {32, 28, 16};
    options.spacing = {2, 2, 3};
    options.displacement_mm = 4;
    options.noise = 0;
    PeerPair pair = phantom_pair("smooth", options, SimilarityType::Lncc, 12, folder_.path() / "images");
    // Another origin, and axes that may be turned: a field in index coordinates or of another world would be found out.
    Matrix<3> direction;
    if (has_turned_axes)
      direction << 0, -1, 0, 1, 0, 0, 0, 0, 1;
    else
      direction.setIdentity();
    for (const auto& file : {pair.fixed, pair.moving, pair.valid, pair.near}) {
      Volume<3> image = read_volume<3>(file);
      image.grid.direction = direction;
      image.grid.origin = {30, -20, 7};
      write_volume<3>(file, image);
    }
    VectorVolume<3> truth = read_vector_volume<3>(pair.truth);
    truth.grid.direction = direction;
    truth.grid.origin = {30, -20, 7};
    for (std::size_t i = 0; i < truth.grid.voxels(); ++i) {
      const float x = truth.component(0)[i], y = truth.component(1)[i];
      truth.component(0)[i] = static_cast<float>(direction(0, 0)) * x + static_cast<float>(direction(0, 1)) * y;
      truth.component(1)[i] = static_cast<float>(direction(1, 0)) * x + static_cast<float>(direction(1, 1)) * y;
    }
    write_vector_volume<3>(pair.truth, truth);
    return pair;
  }

  void expect_its_field(const Method& method, const PeerPair& pair, double share_left) {
    const MethodRun run = method.run(pair, 1, work());
    EXPECT_GT(run.cost.cpu_seconds, 0);
    Row row;
    score(pair, run.displacement, run.warped, row);
    EXPECT_TRUE(row.complaints.empty()) << row.complaints.front();
    EXPECT_LT(*row.find("read_back_percent"), 0.5);
    // The field and the image agree only if there is a motion to agree on.
    EXPECT_LT(*row.find("error_mm"), share_left * *row.find("before_mm"));
  }

  std::filesystem::path script(const std::string& name, const std::string& text) const {
    const auto path = folder_.path() / name;
    std::ofstream(path) << "#!/bin/sh\n" << text;
    std::filesystem::permissions(path, std::filesystem::perms::owner_all);
    return path;
  }
};

TEST_F(PeerMethods, ElastixIsToldDimensionGridAndMetric) {
  PeerPair pair;
  pair.dimension = 3;
  pair.grid_mm = 10;
  pair.similarity = SimilarityType::Lncc;
  const std::string text = elastix_parameters(pair);
  EXPECT_THAT(text, HasSubstr("(FixedImageDimension 3)\n"));
  EXPECT_THAT(text, HasSubstr("(FinalGridSpacingInPhysicalUnits 10)\n"));
  EXPECT_THAT(text, HasSubstr("(Metric \"AdvancedNormalizedCorrelation\")\n"));
  pair.similarity = SimilarityType::Ssd;
  EXPECT_THAT(elastix_parameters(pair), HasSubstr("(Metric \"AdvancedMeanSquares\")\n"));
}

TEST_F(PeerMethods, PlastimatchGoesFromCoarseToFine) {
  PeerPair pair;
  pair.dimension = 3;
  pair.grid_mm = 10;
  const std::string text = plastimatch_parameters(pair, "0.2", {1.4, 1.4, 4}, "f.mha", "m.mha", "out");
  EXPECT_THAT(text, HasSubstr("fixed=f.mha\nmoving=m.mha\nvf_out=out/field.mha\nimg_out=out/warped.mha\n"));
  EXPECT_THAT(text, HasSubstr("regularization_lambda=0.2\n"));
  EXPECT_THAT(text, HasSubstr("grid_spac=40 40 40\nres=4 4 1\n"));
  EXPECT_THAT(text, HasSubstr("grid_spac=20 20 20\nres=2 2 1\n"));
  EXPECT_THAT(text, HasSubstr("grid_spac=10 10 10\nres=1 1 1\n"));
  pair.dimension = 2;
  EXPECT_THAT(plastimatch_parameters(pair, "1", {2, 2, 1}, "", "", ""), HasSubstr("res=4 4 1\n"));
}

// What is not told does not change what comes out, and what is told is part of the setting.
TEST_F(PeerMethods, SettingsTellRunsApart) {
  const PeerPair pair = pair_2d();
  PeerPair finer = pair;
  finer.grid_mm = 3;
  for (const auto& method : {make_elastix("elastix", "transformix"), make_plastimatch("plastimatch", "1")}) {
    EXPECT_EQ(method->setting(pair, 1), method->setting(pair, 1));
    EXPECT_NE(method->setting(pair, 1), method->setting(pair, 2));
    EXPECT_NE(method->setting(pair, 1), method->setting(finer, 1));
    EXPECT_THAT(method->setting(pair, 1), Not(HasSubstr(folder_.path().string())));
  }
}

TEST_F(PeerMethods, SayWhereTheLogOfAFailedRunIs) {
  const auto failing = script("failing", "echo no; exit 4\n"), silent = script("silent", "exit 0\n");
  const PeerPair pair = pair_2d();
  for (const auto& method :
       {make_elastix(failing, failing), make_plastimatch(failing, "1"), make_plastimatch(silent, "1")}) {
    try {
      method->run(pair, 1, work());
      ADD_FAILURE() << method->name();
    } catch (const std::runtime_error& error) {
      EXPECT_THAT(error.what(), HasSubstr((folder_.path() / "work").string()));
    }
  }
}

TEST_F(PeerMethods, SaltusIsAnotherProgramAfterABuild) {
  EXPECT_THROW(make_saltus(folder_.path() / "saltus", "auto", "fast"), std::runtime_error);
  for (const char* name : {"saltus", "saltusd", "saltus-worker"}) script(name, "exit 0\n");
  const PeerPair pair = pair_2d();
  const auto fast = make_saltus(folder_.path() / "saltus", "auto", "fast");
  const std::string before = fast->setting(pair, 1);
  EXPECT_EQ(fast->name(), "saltus fast");
  EXPECT_NE(before, make_saltus(folder_.path() / "saltus", "auto", "balanced")->setting(pair, 1));
  EXPECT_EQ(make_saltus(folder_.path() / "saltus", "gaussian", "fast")->name(), "saltus gaussian fast");
  script("saltus-worker", "exit 1\n");
  EXPECT_NE(before, make_saltus(folder_.path() / "saltus", "auto", "fast")->setting(pair, 1));
}

// Oracle: the true field, and the program's own warped image.
TEST_F(PeerMethods, FieldsOfElastixAreReadAsItMeansThem) {
  const auto elastix = find_program("elastix"), transformix = find_program("transformix");
  if (elastix.empty() || transformix.empty()) GTEST_SKIP() << "elastix is not installed";
  const auto method = make_elastix(elastix, transformix);
  expect_its_field(*method, pair_2d(), 0.6);
  expect_its_field(*method, pair_3d(true), 0.4);
}

TEST_F(PeerMethods, FieldsOfPlastimatchAreReadAsItMeansThem) {
  const auto program = find_program("plastimatch");
  if (program.empty()) GTEST_SKIP() << "plastimatch is not installed";
  const auto method = make_plastimatch(program, "0.005");
  expect_its_field(*method, pair_2d(), 0.6);
  // Of turned axes it does not find the motion.
  expect_its_field(*method, pair_3d(false), 0.5);
}

}  // namespace
}  // namespace saltus::benchmark
