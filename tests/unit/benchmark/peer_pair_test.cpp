#include "tests/benchmark/peers/peer_pair.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "core/evaluation/warp_image.h"
#include "core/image_io/points_io.h"
#include "core/image_io/read_image.h"
#include "core/image_io/write_image.h"
#include "tests/support/temporary_folder.h"

namespace saltus::benchmark {
namespace {

class PeerPairTest : public ::testing::Test {
 protected:
  testing_support::TemporaryFolder folder_;
  std::filesystem::path file(const char* name) const { return folder_.path() / name; }

  PeerPair slip() const {
    PhantomOptions options = default_phantom_options(PhantomKind::Slip);
    options.size = {48, 40, 1};
    return phantom_pair("slip", options, SimilarityType::Ssd, 6, folder_.path());
  }
};

// Oracle: the truth has no error, and no field at all has the error before.
TEST_F(PeerPairTest, ScoresFieldsAgainstTheTruth) {
  const PeerPair pair = slip();
  const auto truth = read_vector_volume<2>(pair.truth);
  const auto moving = read_volume<2>(pair.moving);
  write_volume<2>(file("warped.mha"), warp_image<2>(moving, truth));
  Row row;
  score(pair, pair.truth, file("warped.mha"), row);
  EXPECT_TRUE(row.complaints.empty());
  EXPECT_EQ(*row.find("error_mm"), 0);
  EXPECT_EQ(*row.find("near_mm"), 0);
  EXPECT_NEAR(*row.find("read_back_percent"), 0, 1e-4);
  EXPECT_NEAR(*row.find("before_mm"), 3, 1e-6);

  write_vector_volume<2>(file("still.mha"), VectorVolume<2>(truth.grid));
  Row still;
  score(pair, file("still.mha"), pair.moving, still);
  EXPECT_NEAR(*still.find("error_mm"), 3, 1e-6);
  EXPECT_TRUE(still.complaints.empty());
}

// A field that goes the other way, or with its axes in another order, does not make what its program has made.
TEST_F(PeerPairTest, ComplainsOfAFieldWithAnotherMeaning) {
  const PeerPair pair = slip();
  const auto truth = read_vector_volume<2>(pair.truth);
  write_volume<2>(file("warped.mha"), warp_image<2>(read_volume<2>(pair.moving), truth));
  VectorVolume<2> turned = truth, swapped = truth;
  for (float& value : turned.samples) value = -value;
  for (int c = 0; c < 2; ++c) std::copy_n(truth.component(1 - c), truth.grid.voxels(), swapped.component(c));
  for (const VectorVolume<2>& wrong : {turned, swapped}) {
    write_vector_volume<2>(file("wrong.mha"), wrong);
    Row row;
    score(pair, file("wrong.mha"), file("warped.mha"), row);
    EXPECT_EQ(row.complaints.size(), 1u);
    EXPECT_GT(*row.find("read_back_percent"), 3);
  }
}

TEST_F(PeerPairTest, ComplainsOfAFieldThatIsNotFinite) {
  const PeerPair pair = slip();
  auto field = read_vector_volume<2>(pair.truth);
  field.samples[7] = std::nanf("");
  write_vector_volume<2>(file("nan.mha"), field);
  Row row;
  score(pair, file("nan.mha"), pair.moving, row);
  EXPECT_EQ(row.complaints.size(), 1u);
}

// Oracle: landmarks and a field of one translation, by hand.
TEST_F(PeerPairTest, CountsLandmarksInsideAndOutsideApart) {
  PeerPair pair;
  pair.dimension = 3;
  ImageGrid<3> grid;
  grid.size = {20, 18, 6};
  grid.spacing = {1, 1, 2};
  pair.fixed = pair.moving = file("image.mha");
  Volume<3> image(grid);
  for (std::size_t i = 0; i < image.samples.size(); ++i) image.samples[i] = static_cast<float>(i % 20);
  write_volume<3>(pair.fixed, image);
  pair.inside = {file("in_fixed.csv"), file("in_moving.csv")};
  pair.outside = {file("out_fixed.csv"), file("out_moving.csv")};
  const std::vector<Vector<3>> points = {{5, 5, 4}, {6, 7, 6}, {8, 4, 2}};
  std::vector<Vector<3>> inside = points, outside = points;
  for (auto& p : inside) p[0] += 20;
  for (auto& p : outside) p[1] += 1;
  write_points<3>(pair.inside->fixed, points);
  write_points<3>(pair.inside->moving, inside);
  write_points<3>(pair.outside->fixed, points);
  write_points<3>(pair.outside->moving, outside);
  VectorVolume<3> field(grid);
  std::fill_n(field.component(0), grid.voxels(), 5.0f);
  write_vector_volume<3>(file("field.mha"), field);
  write_volume<3>(file("warped.mha"), warp_image<3>(image, field));
  Row row;
  score(pair, file("field.mha"), file("warped.mha"), row);
  EXPECT_NEAR(*row.find("before_mm"), 20, 1e-6);
  EXPECT_NEAR(*row.find("error_mm"), 15, 1e-5);
  EXPECT_NEAR(*row.find("before_outside_mm"), 1, 1e-6);
  EXPECT_NEAR(*row.find("outside_mm"), std::sqrt(26.0), 1e-5);
  EXPECT_NEAR(*row.find("drag"), 0.25, 1e-6);  // they are given 5 of 20 mm
  EXPECT_EQ(*row.find("folds_percent"), 0);
}

TEST_F(PeerPairTest, NamesWhatIsMissingOfTheSharedImages) {
  try {
    shared_pairs(folder_.path());
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), ::testing::HasSubstr("--data"));
  }
}

}  // namespace
}  // namespace saltus::benchmark
