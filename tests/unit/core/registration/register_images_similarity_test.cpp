// Every similarity, with its default weights, against the truth of a phantom. Those that do not see a contrast turned
// over get a moving image that is dark where the fixed one is bright, in other units and not linearly.
#include <gtest/gtest.h>

#include <cmath>
#include <numeric>
#include <stdexcept>
#include <vector>

#include "core/evaluation/field_error.h"
#include "core/phantom/make_phantom.h"
#include "core/registration/register_images.h"
#include "tests/support/phantom_pair.h"

namespace saltus {
namespace {

bool sees_contrast(SimilarityType similarity) {
  switch (similarity) {
    case SimilarityType::Ssd:
    case SimilarityType::Ncc:
    case SimilarityType::Lncc:
      return true;
    case SimilarityType::Mi:
    case SimilarityType::Ngf:
    case SimilarityType::Mind:
      return false;
  }
  throw std::logic_error("a similarity of which nobody said what it sees");
}

template <int Dim>
double mean_error(const Phantom<Dim>& phantom, const VectorVolume<Dim>& found, const Volume<Dim>& mask) {
  const std::vector<double> errors = endpoint_errors<Dim>(found, phantom.displacement, mask);
  return std::accumulate(errors.begin(), errors.end(), 0.0) / static_cast<double>(errors.size());
}

/// Mean endpoint error, mm, where errors count; null: of no motion at all.
template <int Dim>
double endpoint_error(const Phantom<Dim>& phantom, const VectorVolume<Dim>* found) {
  return mean_error(phantom, found ? *found : VectorVolume<Dim>(phantom.displacement.grid), phantom.masks.valid);
}

template <int Dim>
void expect_registered(const PhantomOptions& scene, SimilarityType similarity, Model model, double factor) {
  SCOPED_TRACE(to_string(scene.kind) + " " + to_string(model));
  const Phantom<Dim> phantom = make_phantom<Dim>(scene);
  RegistrationInput<Dim> input = testing::pair_of(phantom);
  if (!sees_contrast(similarity))
    for (float& v : input.moving.samples) v = 1000 - 50 * v * v;
  RegistrationOptions options = default_options(model, similarity, Preset::Balanced);
  options.pyramid.finest_level = 0;
  options.optimisation.max_iterations = 40;
  const RegistrationResult<Dim> result = register_images<Dim>(input, options);
  EXPECT_LT(endpoint_error(phantom, &result.displacement), endpoint_error<Dim>(phantom, nullptr) / factor);
  EXPECT_LT(result.summary.similarity_after, result.summary.similarity_before);
  EXPECT_LT(result.summary.share_jacobian_not_positive, 0.01);
}

class RegisterBySimilarity : public ::testing::TestWithParam<SimilarityType> {};

TEST_P(RegisterBySimilarity, FindsASmoothMotion) {
  PhantomOptions scene = default_phantom_options(PhantomKind::Smooth);
  scene.size = {64, 64, 1};
  scene.displacement_mm = 6;
  expect_registered<2>(scene, GetParam(), Model::Gaussian, 4);
}

TEST_P(RegisterBySimilarity, FindsASlip) {
  PhantomOptions scene = default_phantom_options(PhantomKind::Slip);
  scene.size = {72, 72, 1};
  expect_registered<2>(scene, GetParam(), Model::Sliding, 3);
}

/// Share of what first-order momenta there are, along the axes or oriented, that lies within 3 voxels of the interface.
double share_at_interface(const Phantom<2>& phantom, const RegistrationResult<2>& result) {
  double near = 0, all = 0;
  for (const MomentumField<2>& field : result.momenta) {
    if (field.axis == MomentumField<2>::kZeroth) continue;
    const ImageGrid<2>&grid = field.vectors.grid, &whole = phantom.masks.near.grid;
    for (std::size_t i = 0; i < grid.voxels(); ++i) {
      const auto x = static_cast<long>(i) % grid.size[0], y = static_cast<long>(i) / grid.size[0];
      // Axes are those of the world.
      const long column = std::lround((grid.origin[0] + x * grid.spacing[0] - whole.origin[0]) / whole.spacing[0]),
                 row = std::lround((grid.origin[1] + y * grid.spacing[1] - whole.origin[1]) / whole.spacing[1]);
      const double momentum = std::hypot(field.vectors.component(0)[i], field.vectors.component(1)[i]);
      all += momentum;
      if (phantom.masks.near.samples[static_cast<std::size_t>(row * whole.size[0] + column)] != 0) near += momentum;
    }
  }
  return near / all;
}

// What `auto` chooses has to serve every similarity. Oracles: order 0 alone, overall and near the interface, and the
// place of the interface, where a twentieth of the image is.
TEST_P(RegisterBySimilarity, SlidesWithAutoWhereTheInterfaceIs) {
  double error = 0, near = 0, smooth_error = 0, smooth_near = 0, share = 0;
  bool has_axes = false;
  for (const double degrees : {0.0, 20.0, 45.0}) {
    PhantomOptions scene = default_phantom_options(PhantomKind::Slip);
    scene.angle_deg = degrees;
    scene.size = {96, 96, 1};
    scene.noise = 0.01;
    const Phantom<2> phantom = make_phantom<2>(scene);
    RegistrationInput<2> input = testing::pair_of(phantom);
    if (!sees_contrast(GetParam()))
      for (float& v : input.moving.samples) v = 1000 - 50 * v * v;
    const RegistrationResult<2> result =
        register_images<2>(input, default_options(Model::Auto, GetParam(), Preset::Balanced));
    bool slides = false;
    for (const LevelSummary& level : result.summary.levels) slides |= level.decision == FirstOrderDecision::LetIn;
    ASSERT_TRUE(slides) << degrees;
    share += share_at_interface(phantom, result) / 3;
    for (const MomentumField<2>& field : result.momenta) has_axes |= field.axis >= 0;
    error += mean_error(phantom, result.displacement, phantom.masks.valid);
    near += mean_error(phantom, result.displacement, phantom.masks.near);
    const RegistrationResult<2> smooth =
        register_images<2>(input, default_options(Model::Gaussian, GetParam(), Preset::Balanced));
    smooth_error += mean_error(phantom, smooth.displacement, phantom.masks.valid);
    smooth_near += mean_error(phantom, smooth.displacement, phantom.masks.near);
  }
  EXPECT_LT(error, smooth_error);
  EXPECT_LT(near, 0.8 * smooth_near);
  EXPECT_GT(share, 0.55);
  EXPECT_FALSE(has_axes && !sees_contrast(GetParam())) << "elements stand alone, also along the axes";
}

TEST_P(RegisterBySimilarity, FindsASmoothMotionInThreeDimensions) {
  PhantomOptions scene = default_phantom_options(PhantomKind::Smooth, 3);
  scene.size = {28, 26, 24};
  scene.displacement_mm = 3;
  expect_registered<3>(scene, GetParam(), Model::Gaussian, 2);
}

// A weight that holds noise back would hold back motion that is large as well, were it that of all scales.
TEST(RegisterBySelfSimilarity, FindsALargeMotion) {
  PhantomOptions scene = default_phantom_options(PhantomKind::Smooth);
  scene.size = {192, 192, 1};
  scene.displacement_mm = 20;
  scene.noise = 0.01;
  const Phantom<2> phantom = make_phantom<2>(scene);
  const RegistrationInput<2> input = testing::pair_of(phantom);
  RegistrationOptions options = default_options(Model::Auto, SimilarityType::Mind, Preset::Balanced);
  const auto error_of = [&](double share) {
    options.momenta.coarser_regularisation = share;
    return mean_error(phantom, register_images<2>(input, options).displacement, phantom.masks.valid);
  };
  const double error = error_of(options.momenta.coarser_regularisation);
  EXPECT_LT(error, 0.1 * endpoint_error<2>(phantom, nullptr));
  EXPECT_LT(error, 0.5 * error_of(1));
}

// At rest all voxels lie on samples, where noise is sharpest and slopes have jumps: those of one side alone point
// nowhere that lowers the energy, and nothing moved.
TEST(RegisterImages, MindLeavesTheVoxelsThatItBeginsOn) {
  PhantomOptions scene = default_phantom_options(PhantomKind::Smooth, 3);
  scene.size = {40, 40, 40};
  scene.displacement_mm = 5;
  scene.noise = 0.03;
  const Phantom<3> phantom = make_phantom<3>(scene);
  RegistrationOptions options = default_options(Model::Gaussian, SimilarityType::Mind, Preset::Balanced);
  options.pyramid.levels = 1;
  const RegistrationResult<3> result = register_images<3>(testing::pair_of(phantom), options);
  EXPECT_LT(endpoint_error(phantom, &result.displacement), endpoint_error<3>(phantom, nullptr) / 5);
}

INSTANTIATE_TEST_SUITE_P(Similarities, RegisterBySimilarity, ::testing::ValuesIn(all_similarities()),
                         [](const auto& info) { return to_string(info.param); });

}  // namespace
}  // namespace saltus
