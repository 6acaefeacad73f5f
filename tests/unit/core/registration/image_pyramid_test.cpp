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

}  // namespace
}  // namespace saltus
