// A narrower scale of order 0 where detail is left. Oracle: the true motion.
#include <gtest/gtest.h>

#include <algorithm>

#include "core/evaluation/field_error.h"
#include "core/evaluation/statistics.h"
#include "core/evaluation/warp_image.h"
#include "core/phantom/make_phantom.h"
#include "core/registration/register_images.h"
#include "tests/support/phantom_pair.h"
#include "tests/support/random_fields.h"

namespace saltus {
namespace {

using testing::pair_of;

double error_of(const Phantom<3>& phantom, const RegistrationResult<3>& found) {
  return summarise(endpoint_errors<3>(found.displacement, phantom.displacement, phantom.masks.valid)).mean;
}

double error_of(const Phantom<3>& phantom, const RegistrationOptions& options) {
  return error_of(phantom, register_images<3>(pair_of(phantom), options));
}

/// Two images between which everything has moved a little by itself: in plane waves of 6 voxels and more.
Phantom<3> detailed_scene() {
  PhantomOptions scene = default_phantom_options(PhantomKind::Smooth, 3);
  scene.size = {64, 64, 64};
  scene.noise = 0.002;
  Phantom<3> detailed = make_phantom<3>(scene);
  for (int c = 0; c < 3; ++c) {
    const std::vector<double> waves = testing::random_waves<3>(lattice_of(detailed.fixed.grid), c + 1);
    std::transform(waves.begin(), waves.end(), detailed.displacement.component(c),
                   [](double wave) { return static_cast<float>(2 * wave); });
  }
  detailed.fixed = warp_image<3>(detailed.moving, detailed.displacement, {Interpolation::BSpline});
  return detailed;
}

class Narrower : public ::testing::TestWithParam<SimilarityType> {};

// Order 0 that stays alone gets a narrower scale where there is something left for it, and otherwise is as it would be
// without.
TEST_P(Narrower, FollowsDetailAndNoNoise) {
  const RegistrationOptions options = default_options(Model::Auto, GetParam(), Preset::Balanced);
  RegistrationOptions without = options, follows = options;
  without.momenta.narrower_pull = 0;
  // By itself ssd asks for more than is here: where two scans differ in intensity that pulls as well.
  if (GetParam() == SimilarityType::Ssd) follows.momenta.narrower_pull = 1e-9;
  const Phantom<3> detailed = detailed_scene();
  const LevelSummary finest = register_images<3>(pair_of(detailed), follows).summary.levels.back();
  EXPECT_TRUE(finest.has_narrower) << finest.narrow_pull;
  EXPECT_EQ(finest.decision, FirstOrderDecision::LeftOut);
  EXPECT_EQ(finest.map_steps, GetParam() == SimilarityType::Lncc ? 4 : 3)
      << "twice as many as two, or half as many again where the flow has closer sites";
  EXPECT_LT(error_of(detailed, follows), 0.9 * error_of(detailed, without));

  PhantomOptions scene = default_phantom_options(PhantomKind::Smooth, 3);
  scene.size = {64, 64, 64};
  scene.displacement_mm = 4;
  for (double noise : {0.0, 0.02}) {
    scene.noise = noise;
    const Phantom<3> smooth = make_phantom<3>(scene);
    const RegistrationResult<3> found = register_images<3>(pair_of(smooth), options);
    EXPECT_GT(found.summary.levels.back().narrow_pull, 0);
    EXPECT_FALSE(found.summary.levels.back().has_narrower) << found.summary.levels.back().narrow_pull;
    EXPECT_EQ(found.displacement.samples, register_images<3>(pair_of(smooth), without).displacement.samples);
  }
}

// Where `accurate` takes images that are finer than the scales of order 0 are, detail is asked for on the level before,
// whose images are those that it was measured on, and the finest level goes on with what was found.
TEST(NarrowerScale, IsFoundBeforeImagesThatAreFinerThanOrder0) {
  const Phantom<3> detailed = detailed_scene();
  RegistrationOptions options = default_options(Model::Auto, SimilarityType::Ncc, Preset::Accurate), without = options;
  without.momenta.narrower_pull = 0;
  const RegistrationResult<3> found = register_images<3>(pair_of(detailed), options);
  ASSERT_EQ(found.options.momenta.finest_scale, 1);
  const std::vector<LevelSummary>& levels = found.summary.levels;
  ASSERT_EQ(found.options.pyramid.finest_level, 0);
  const LevelSummary &before = levels[levels.size() - 2], &finest = levels.back();
  EXPECT_TRUE(before.has_narrower) << before.narrow_pull << " " << before.own_pull;
  EXPECT_EQ(before.rounds, 2);
  EXPECT_EQ(finest.decision, FirstOrderDecision::LeftOut);
  EXPECT_EQ(finest.narrow_pull, -1) << "it is asked once";
  EXPECT_FALSE(finest.has_narrower);
  EXPECT_LT(error_of(detailed, found), 0.9 * error_of(detailed, without));

  // What shows that something slides is left to first orders, where they come on the finest level.
  options.momenta.first_order_finest_scale = 0;
  options.momenta.first_order_shear = 1e-9;
  options.momenta.sparsity = 1e6;
  options.momenta.orientations = 0;
  options.optimisation.max_iterations = 15;
  options.optimisation.tolerance = options.optimisation.look_tolerance = 0.1;
  const auto shown = register_images<3>(pair_of(detailed), options).summary.levels;
  for (const LevelSummary& level : shown) EXPECT_EQ(level.narrow_pull, -1) << level.level;
  EXPECT_GE(shown[shown.size() - 2].simple_shear, 1e-9) << "a report has to say why";
  EXPECT_EQ(shown.front().simple_shear, 0);
  options.momenta.first_order_shear = 1e9;
  const auto other = register_images<3>(pair_of(detailed), options).summary.levels;
  EXPECT_GT(other[other.size() - 2].narrow_pull, 0);
  EXPECT_EQ(other[other.size() - 2].simple_shear, shown[shown.size() - 2].simple_shear);
}

// A round may end at its limit. What counts is then whether it would have ended by the tolerance of other rounds.
TEST(NarrowerScale, IsAskedForAtTheLimitOnceOrder0IsAtRest) {
  const Phantom<3> detailed = detailed_scene();
  RegistrationOptions options = default_options(Model::Auto, SimilarityType::Ncc, Preset::Balanced);
  options.optimisation.look_tolerance = 1e-9;
  options.optimisation.max_iterations = 40;
  const auto finest_of = [&] { return register_images<3>(pair_of(detailed), options).summary.levels.back(); };
  const LevelSummary at_rest = finest_of();
  EXPECT_EQ(at_rest.termination, Termination::IterationLimit);
  EXPECT_TRUE(at_rest.has_narrower) << at_rest.narrow_pull << " " << at_rest.own_pull;
  EXPECT_EQ(at_rest.iterations, 80);
  options.optimisation.tolerance = 1e-9;
  EXPECT_EQ(finest_of().narrow_pull, -1);
}

// It is not asked of order 0 that has not settled, nor of one whose scales end elsewhere than the level; and what pulls
// at the finest scale as well is not for a narrower one.
TEST(NarrowerScale, IsForWhatWiderOnesCannotFollow) {
  const Phantom<3> detailed = detailed_scene();
  RegistrationOptions options = default_options(Model::Auto, SimilarityType::Lncc, Preset::Balanced);
  options.momenta.narrower_pull = 1e-9;
  const auto levels_of = [&](const Phantom<3>& phantom, const RegistrationOptions& asked) {
    return register_images<3>(pair_of(phantom), asked).summary.levels;
  };
  RegistrationOptions unsettled = options, finer = options, coarser = options;
  unsettled.optimisation.max_iterations = 3;
  finer.momenta.finest_scale = 0;
  coarser.momenta.finest_scale = 2;
  for (const RegistrationOptions& other : {unsettled, finer, coarser})
    for (const LevelSummary& level : levels_of(detailed, other)) EXPECT_EQ(level.narrow_pull, -1) << level.level;
  EXPECT_TRUE(levels_of(detailed, options).back().has_narrower);

  // Order 0 that is held so much leaves behind what is smooth.
  PhantomOptions scene = default_phantom_options(PhantomKind::Smooth, 3);
  scene.size = {64, 64, 64};
  scene.displacement_mm = 4;
  options.momenta.regularisation = 1e-2;
  const LevelSummary held = levels_of(make_phantom<3>(scene), options).back();
  EXPECT_GT(held.narrow_pull, options.momenta.narrower_pull);
  EXPECT_LT(held.narrow_pull, 1.1 * held.own_pull);
  EXPECT_FALSE(held.has_narrower);
}

INSTANTIATE_TEST_SUITE_P(Similarities, Narrower, ::testing::ValuesIn(all_similarities()),
                         [](const auto& info) { return to_string(info.param); });

}  // namespace
}  // namespace saltus
