// Model directional: where its direction comes from, what it refuses, and what it finds.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "core/registration/direction.h"
#include "core/support/errors.h"
#include "tests/support/analytic_scene.h"

namespace saltus {
namespace {

using ::testing::HasSubstr;

/// The side of the line through the origin with normal n that n points to slides along the line, the other side back.
RegistrationInput<2> sliding_along_line(const Vector<2>& n, const Matrix<2>& axes) {
  const testing::AnalyticScene<2> scene(14, 2.5, 80, 5);
  const ImageGrid<2> grid = testing::centred_grid<2>({40, 36}, {1, 1}, axes);
  const Vector<2> t(-n[1], n[0]);
  RegistrationInput<2> input;
  input.moving = testing::sampled<2>(grid, scene);
  input.fixed = testing::sampled<2>(grid, [&](Vector<2> x) { return scene(x + (n.dot(x) > 0 ? 1.5 : -1.5) * t); });
  return input;
}

RegistrationOptions quick(Model model) {
  RegistrationOptions options = default_options(model, SimilarityType::Ssd, Preset::Balanced);
  options.pyramid.levels = 2;
  options.momenta.width_voxels = 5;
  options.momenta.scales = 2;
  options.momenta.sparsity = 0;
  options.optimisation.max_iterations = 25;
  return options;
}

VectorVolume<2> everywhere(const ImageGrid<2>& grid, const Vector<2>& w) {
  VectorVolume<2> field(grid);
  for (int c = 0; c < 2; ++c)
    for (std::size_t voxel = 0; voxel < grid.voxels(); ++voxel) field.component(c)[voxel] = static_cast<float>(w[c]);
  return field;
}

std::string refusal(const RegistrationInput<2>& input, const RegistrationOptions& options) {
  try {
    frame_directions(input, options);
  } catch (const InvalidInput& error) {
    return error.what();
  }
  return "accepted";
}

TEST(DirectionalModel, ReadsItsDirectionFromText) {
  RegistrationOptions options = quick(Model::Directional);
  set_parameter(options, "direction", "0.6,-0.8");
  EXPECT_THAT(options.momenta.direction, ::testing::ElementsAre(0.6, -0.8));
  set_parameter(options, "direction", "0,0,1");
  EXPECT_EQ(options.momenta.direction.size(), 3u);
  set_parameter(options, "direction", "none");
  EXPECT_TRUE(options.momenta.direction.empty());
  for (const char* wrong : {"1", "0,0", "1,1", "0.6,-0.8,", "x,1", "1,0,0,0", "nan,1", ""})
    EXPECT_THROW(set_parameter(options, "direction", wrong), InvalidInput) << wrong;
}

TEST(DirectionalModel, RefusesADirectionThatIsMissingDoubleOrNoneOfItsOwn) {
  RegistrationInput<2> input = sliding_along_line({1, 0}, Matrix<2>::Identity());
  RegistrationOptions options = quick(Model::Directional);
  EXPECT_THAT(refusal(input, options), HasSubstr("model directional has no direction; set parameter direction"));
  options.momenta.direction = {0, 0, 1};
  EXPECT_THAT(refusal(input, options), HasSubstr("has 3 components and the images have 2 dimensions"));
  options.momenta.direction = {1, 0};
  EXPECT_EQ(refusal(input, options), "accepted");
  input.direction = everywhere(input.fixed.grid, {1, 0});
  EXPECT_THAT(refusal(input, options), HasSubstr("give one of them"));
  EXPECT_THAT(refusal(input, quick(Model::Sliding)), HasSubstr("the model is sliding; only model directional"));
}

TEST(DirectionalModel, RefusesAFieldThatIsNotOfUnitVectorsOnTheFixedGrid) {
  RegistrationInput<2> input = sliding_along_line({1, 0}, Matrix<2>::Identity());
  const RegistrationOptions options = quick(Model::Directional);
  input.direction = everywhere(input.fixed.grid, {1, 0});
  input.direction->component(0)[17] = 0.5f;
  EXPECT_THAT(refusal(input, options), HasSubstr("vector of length 0.5 at voxel 17; vectors must have length 1, or 0"));
  input.direction->component(0)[17] = std::nanf("");
  EXPECT_THAT(refusal(input, options), HasSubstr("vector of length nan at voxel 17"));
  input.direction->component(0)[17] = 0;
  EXPECT_EQ(refusal(input, options), "accepted");
  input.direction = everywhere(input.fixed.grid, {0, 0});
  EXPECT_THAT(refusal(input, options), HasSubstr("0 everywhere"));
  input.direction = everywhere(input.fixed.grid, {1, 0});
  input.direction->grid.origin[0] += 3;
  EXPECT_THAT(refusal(input, options), HasSubstr("lies up to 3 mm from the fixed image"));
  input.direction->grid.size[0] -= 1;
  EXPECT_THAT(refusal(input, options), HasSubstr("different sizes"));
}

TEST(DirectionalModel, TurnsDirectionsIntoTheFrameOfTheFixedImage) {
  Matrix<2> axes;
  axes << 0, -1, 1, 0;
  const RegistrationInput<2> input = sliding_along_line({1, 0}, axes);
  RegistrationOptions options = quick(Model::Directional);
  options.momenta.direction = {0.6, 0.8};
  const Field<double> w = frame_directions(input, options);
  ASSERT_EQ(w.size(), 2 * input.fixed.grid.voxels());
  EXPECT_NEAR(w[10], 0.8, 1e-12);  // the first axis points along world y
  EXPECT_NEAR(w[11], -0.6, 1e-12);
}

/// Jump of the displacement along t across the line, mean of places along it, 1.5 mm from it on either side.
double jump_across(const RegistrationResult<2>& result, const Vector<2>& n) {
  const Vector<2> t(-n[1], n[0]);
  double sum = 0;
  for (int k = -6; k <= 6; ++k)
    sum += t.dot(testing::vector_at<2>(result.displacement, 1.5 * n + k * t) -
                 testing::vector_at<2>(result.displacement, -1.5 * n + k * t)) /
           13;
  return sum;
}

// Oracle: the scene's own slip, 3 mm between the sides, and the smooth model for comparison; on a grid turned by 90
// degrees the direction is still the world's.
TEST(DirectionalModel, RecoversTheSlipAcrossItsDirection) {
  Matrix<2> turned;
  turned << 0, -1, 1, 0;
  for (const Matrix<2>& axes : {Matrix<2>(Matrix<2>::Identity()), turned}) {
    const Vector<2> n(1, 0);
    const RegistrationInput<2> input = sliding_along_line(n, axes);
    RegistrationOptions options = quick(Model::Directional);
    options.momenta.direction = {1, 0};
    const double jump = jump_across(register_images<2>(input, options), n),
                 smooth = jump_across(register_images<2>(input, quick(Model::Gaussian)), n);
    EXPECT_NEAR(jump, 3, 0.6);
    EXPECT_GT(jump, smooth + 0.3);
  }
}

// w and -w are one direction, and a constant field is the constant parameter.
TEST(DirectionalModel, DoesNotDependOnTheSignOfItsDirectionOrWhereItComesFrom) {
  RegistrationInput<2> input = sliding_along_line({0.8, 0.6}, Matrix<2>::Identity());
  RegistrationOptions options = quick(Model::Directional);
  options.optimisation.max_iterations = 6;
  options.momenta.sparsity = 1e-4;
  options.momenta.direction = {0.8, 0.6};
  const RegistrationResult<2> one = register_images<2>(input, options);
  options.momenta.direction = {-0.8, -0.6};
  EXPECT_EQ(register_images<2>(input, options).displacement.samples, one.displacement.samples);
  EXPECT_GT(one.summary.active_first_order_share, 0);
  // Momenta are given out for each axis, m_i = w_i m_w.
  ASSERT_EQ(one.momenta.size(), 6u);
  EXPECT_EQ(one.momenta[1].axis, 0);
  EXPECT_EQ(one.momenta[2].axis, 1);
  for (std::size_t i = 0; i < one.momenta[1].vectors.samples.size(); ++i)
    EXPECT_NEAR(0.6f * one.momenta[1].vectors.samples[i], 0.8f * one.momenta[2].vectors.samples[i], 1e-5f);

  options.momenta.direction.clear();
  input.direction = everywhere(input.fixed.grid, {0.8, 0.6});
  const RegistrationResult<2> field = register_images<2>(input, options);
  for (std::size_t i = 0; i < one.displacement.samples.size(); ++i)
    ASSERT_NEAR(field.displacement.samples[i], one.displacement.samples[i], 1e-3f);
}

// No direction, no first-order momentum.
TEST(DirectionalModel, HasNoFirstOrderMomentumWhereItsDirectionIsZero) {
  RegistrationInput<2> input = sliding_along_line({1, 0}, Matrix<2>::Identity());
  input.direction = everywhere(input.fixed.grid, {1, 0});
  for (std::size_t voxel = 0; voxel < 20 * 40; ++voxel) input.direction->component(0)[voxel] = 0;
  RegistrationOptions options = quick(Model::Directional);
  options.optimisation.max_iterations = 6;
  const RegistrationResult<2> result = register_images<2>(input, options);
  const VectorVolume<2>& fine = result.momenta.at(4).vectors;
  ASSERT_EQ(fine.grid.size[1], 36);
  double beyond = 0;
  for (std::size_t voxel = 0; voxel < fine.grid.voxels(); ++voxel) {
    const double m = std::abs(fine.component(0)[voxel]) + std::abs(fine.component(1)[voxel]);
    if (voxel < 20 * 40)
      EXPECT_EQ(m, 0);
    else
      beyond += m;
  }
  EXPECT_GT(beyond, 0);
}

}  // namespace
}  // namespace saltus
