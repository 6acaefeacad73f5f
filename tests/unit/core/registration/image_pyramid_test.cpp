#include "core/registration/image_pyramid.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "core/grid/noise.h"
#include "core/registration/scales.h"

namespace saltus {
namespace {

/// A wave with white noise of `noise` times its range, and options that are resolved for it.
struct Noisy {
  RegistrationInput<2> input;
  RegistrationOptions options;

  Noisy(double noise, SimilarityType similarity, double spacing_y = 1) {
    ImageGrid<2> grid;
    grid.size = {96, 96};
    grid.spacing[1] = spacing_y;
    std::mt19937 random(5);
    std::normal_distribution<double> normal;
    for (Volume<2>* image : {&input.fixed, &input.moving}) {
      *image = Volume<2>(grid);
      for (std::size_t voxel = 0; voxel < grid.voxels(); ++voxel)
        image->samples[voxel] =
            static_cast<float>(100 * std::sin(0.07 * static_cast<double>(voxel % 96)) + 200 * noise * normal(random));
    }
    options = resolved(default_options(Model::Sliding, similarity, Preset::Balanced), lattice_of(grid));
  }
};

// Oracle: 1 / (1 + (noise / residual)^2), where a sample of a coarser level of a plane averages 4 and so halves the
// noise.
TEST(ImagePyramid, TrustsSsdTheMoreTheLessNoiseALevelHas) {
  Noisy scene(0, SimilarityType::Ssd);
  scene.options.similarity_parameters.noise = 2 * scene.options.similarity_parameters.ssd_residual;
  scene.options.similarity_parameters.weight = 3;
  scene.options.flow.divergence_weight = 0.5;
  const ImagePyramid<2> pyramid(scene.input, scene.options);
  for (const auto& [level, share] : {std::pair{0, 0.2}, {1, 0.5}, {2, 0.8}}) {
    EXPECT_NEAR(pyramid.level(level).similarity_weight, 3 * share, 1e-12) << level;
    EXPECT_NEAR(pyramid.level(level).divergence_weight, 0.5 * std::sqrt(share), 1e-12) << level;
  }
  EXPECT_EQ(pyramid.full_resolution().similarity_weight, pyramid.level(0).similarity_weight);
  EXPECT_EQ(pyramid.similarity_weight(0), pyramid.level(0).similarity_weight);
}

// Lines 3 mm apart stay as they are on the levels of 2 and 4 mm, whose samples average two and four along the lines.
TEST(ImagePyramid, CountsOnlyTheSamplesThatALevelAverages) {
  Noisy scene(0, SimilarityType::Ssd, 3);
  scene.options.similarity_parameters.noise = 2 * scene.options.similarity_parameters.ssd_residual;
  const ImagePyramid<2> pyramid(scene.input, scene.options);
  for (const auto& [level, share] : {std::pair{0, 1.0 / 5}, {1, 1.0 / 3}, {2, 1.0 / 2}})
    EXPECT_NEAR(pyramid.similarity_weight(level), share * scene.options.similarity_parameters.weight, 1e-12) << level;
  EXPECT_GT(pyramid.smoothing_voxels(0), pyramid.smoothing_voxels(1));
}

TEST(ImagePyramid, TrustsCorrelationsWhateverTheNoise) {
  Noisy scene(0, SimilarityType::Lncc);
  scene.options.similarity_parameters.noise = 0.1;
  const ImagePyramid<2> pyramid(scene.input, scene.options);
  for (int level : {0, 1}) {
    EXPECT_EQ(pyramid.level(level).similarity_weight, scene.options.similarity_parameters.weight);
    EXPECT_EQ(pyramid.level(level).divergence_weight, scene.options.flow.divergence_weight);
  }
}

// Oracle: the noise put in, and that of the level's own images, which is at most what it is taken for.
TEST(ImagePyramid, MeasuresTheNoiseOfItsImages) {
  const Noisy scene(0.05, SimilarityType::Ssd);
  const ImagePyramid<2> pyramid(scene.input, scene.options);
  EXPECT_NEAR(pyramid.noise(), 0.05, 0.007);  // of a range that the noise widens
  EXPECT_GT(pyramid.smoothing_voxels(0), pyramid.smoothing_voxels(1));
  EXPECT_GT(pyramid.similarity_weight(1), 2 * pyramid.similarity_weight(0));
  const MatchingLevel<2, float> coarser = pyramid.level(1);
  EXPECT_LT(noise_sd<2>(coarser.lattice, coarser.fixed.data(), static_cast<const float*>(nullptr)),
            0.5 * pyramid.noise());
}

/// Discs on a black ground, of the radius 12 mm, the moving one 5 mm to the right.
RegistrationInput<2> discs() {
  RegistrationInput<2> input;
  ImageGrid<2> grid;
  grid.size = {96, 80};
  for (const auto& [image, centre] : {std::pair{&input.fixed, Vector<2>(50, 30)}, {&input.moving, Vector<2>(55, 30)}}) {
    *image = Volume<2>(grid);
    for (std::size_t voxel = 0; voxel < grid.voxels(); ++voxel) {
      const Vector<2> x(static_cast<double>(voxel % 96), static_cast<double>(voxel / 96));
      image->samples[voxel] = static_cast<float>(std::max(0.0, 1 - (x - centre).squaredNorm() / 144));
    }
  }
  return input;
}

TEST(ImagePyramid, ComparesImagesWhereEitherShowsSomething) {
  const RegistrationInput<2> input = discs();
  RegistrationOptions options =
      resolved(default_options(Model::Auto, SimilarityType::Ssd, Preset::Balanced), lattice_of(input.fixed.grid));
  ASSERT_EQ(options.pyramid.region_margin, 4);
  const ImagePyramid<2> pyramid(input, options);
  ASSERT_TRUE(pyramid.region());
  // The outermost 2 % of the range are background.
  EXPECT_EQ(*pyramid.region(), (IndexBox<2>{{39, 19}, {67, 42}}));
  const Lattice<2> finest = pyramid.lattice(0), coarse = pyramid.lattice(1);
  EXPECT_EQ(finest, (Lattice<2>{{36, 31}, {1, 1}, {35, 15}}));
  EXPECT_EQ(coarse.spacing, (std::array<double, 2>{2, 2}));
  EXPECT_LE(coarse.offset[0], 39 - 4 * 2);
  EXPECT_GE(coarse.offset[0] + 2 * (coarse.size[0] - 1), 66 + 4 * 2);
  const MatchingLevel<2, float> level = pyramid.level(0), all = pyramid.full_resolution();
  EXPECT_EQ(level.lattice, finest);
  EXPECT_EQ(all.lattice, lattice_of(input.fixed.grid));
  EXPECT_EQ(level.fixed, samples_of_part(all.lattice, all.fixed, finest));
  EXPECT_EQ(level.moving.lattice, all.moving.lattice);

  options.pyramid.region_margin = -1;
  EXPECT_EQ(ImagePyramid<2>(input, options).lattice(0), lattice_of(input.fixed.grid));
  EXPECT_FALSE(ImagePyramid<2>(input, options).region());
}

// The affine start says where in the fixed image the moving one lies.
TEST(ImagePyramid, ComparesWhereTheStartBringsTheMovingImage) {
  RegistrationInput<2> input = discs();
  input.start = AffineMap<2>{Matrix<2>::Identity(), Vector<2>(0, -20)};  // seen from the fixed image 20 mm lower
  const RegistrationOptions options =
      resolved(default_options(Model::Auto, SimilarityType::Ssd, Preset::Balanced), lattice_of(input.fixed.grid));
  const auto region = ImagePyramid<2>(input, options).region();
  ASSERT_TRUE(region);
  EXPECT_EQ(*region, (IndexBox<2>{{39, 19}, {67, 62}}));
}

// What lies around what an image shows pulls at nothing, however much of the image it is.
TEST(ImagePyramid, HasTheContrastOfWhatTheImageShows) {
  const auto contrast = [](int margin, SimilarityType similarity) {
    const int side = 64 + 2 * margin;
    RegistrationInput<2> input;
    ImageGrid<2> grid;
    grid.size = {side, side};
    input.fixed = Volume<2>(grid);
    for (int y = 0; y < 64; ++y)
      for (int x = 0; x < 64; ++x)
        input.fixed.samples[static_cast<std::size_t>((y + margin) * side + x + margin)] =
            static_cast<float>(100 + 40 * std::sin(0.4 * x) * std::cos(0.3 * y));
    input.moving = input.fixed;
    const RegistrationOptions options =
        resolved(default_options(Model::Sliding, similarity, Preset::Balanced), lattice_of(input.fixed.grid));
    return ImagePyramid<2>(input, options).contrast();
  };
  // The range of intensities, between percentiles, depends a little on how much there is of each.
  const double tight = contrast(6, SimilarityType::Ssd), wide = contrast(40, SimilarityType::Ssd);
  EXPECT_NEAR(wide, tight, 0.1 * tight);
  EXPECT_TRUE(std::isinf(contrast(6, SimilarityType::Lncc)));
}

}  // namespace
}  // namespace saltus
