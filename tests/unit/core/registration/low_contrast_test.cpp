// Oracle: the phantoms' true motion, and registrations that have the same weight in another way.
#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>

#include "core/evaluation/field_error.h"
#include "core/phantom/make_phantom.h"
#include "core/registration/register_images.h"
#include "tests/support/phantom_pair.h"

namespace saltus {
namespace {

using testing::pair_of;

// The phantom's wheel is an angular ramp: a tenth of the gradient that textures have. What holds momenta back where
// images show more would then hold back what is seen.
TEST(LowContrast, IsFollowed) {
  PhantomOptions scene = default_phantom_options(PhantomKind::Wheel);
  scene.size = {128, 128, 1};
  const Phantom<2> phantom = make_phantom<2>(scene);
  RegistrationOptions options = default_options(Model::Auto, SimilarityType::Ssd, Preset::Balanced);
  const auto error_of = [&](const RegistrationResult<2>& result) {
    const auto errors = endpoint_errors<2>(result.displacement, phantom.displacement, phantom.masks.valid);
    return std::accumulate(errors.begin(), errors.end(), 0.0);
  };
  const RegistrationResult<2> followed = register_images<2>(pair_of(phantom), options);
  options.momenta.full_contrast = 0;
  const RegistrationResult<2> not_followed = register_images<2>(pair_of(phantom), options);
  const auto is_let_in = [](const LevelSummary& level) { return level.decision == FirstOrderDecision::LetIn; };
  EXPECT_TRUE(std::any_of(followed.summary.levels.begin(), followed.summary.levels.end(), is_let_in));
  EXPECT_LT(error_of(followed), 0.9 * error_of(not_followed));
}

// Only a level that begins with what a coarser one has found, and with a round that another one follows, sees it.
TEST(LowContrast, EndsTheFirstRoundOfALevelByAToleranceOfItsOwn) {
  const RegistrationInput<2> input = pair_of(make_phantom<2>(default_phantom_options(PhantomKind::Slip)));
  const auto evaluations = [&](double round, double first) {
    RegistrationOptions options = default_options(Model::Sliding, SimilarityType::Ssd, Preset::Balanced);
    options.pyramid.levels = 3;
    options.momenta.first_order_scales = 2;
    options.momenta.reweighted_rounds = 2;
    options.optimisation.round_tolerance = round;
    options.optimisation.first_round_tolerance = first;
    options.threads = 1;
    std::vector<int> of_levels;
    for (const LevelSummary& level : register_images<2>(input, options).summary.levels)
      of_levels.push_back(level.evaluations);
    return of_levels;
  };
  const std::vector<int> as_others = evaluations(0.5, -1), at_once = evaluations(0.5, 1), late = evaluations(0.5, 0);
  EXPECT_EQ(evaluations(0.5, 0.5), as_others);
  ASSERT_EQ(at_once.size(), 3u);
  EXPECT_EQ(at_once[0], late[0]) << "nothing has been found before";
  EXPECT_EQ(at_once[1], late[1]) << "nothing has been found before";
  EXPECT_LT(at_once[2], late[2]);
}

// On one level first orders are there from the start, and there is no other weight before.
TEST(LowContrast, GivesOrder0ItsWeightBesideFirstOrdersFromWhereTheyAreThere) {
  const RegistrationInput<2> input = pair_of(make_phantom<2>(default_phantom_options(PhantomKind::Slip)));
  RegistrationOptions beside = default_options(Model::Sliding, SimilarityType::Ssd, Preset::Balanced);
  beside.pyramid.levels = 1;
  beside.optimisation.max_iterations = 5;
  beside.threads = 1;
  RegistrationOptions alone = beside;
  beside.momenta.regularisation = 3e-5;
  beside.momenta.regularisation_beside_first = 1e-5;
  alone.momenta.regularisation = 1e-5;
  const auto with = register_images<2>(input, beside), without = register_images<2>(input, alone);
  EXPECT_EQ(with.displacement.samples, without.displacement.samples);
  // Where they are left out, order 0 keeps its own.
  for (RegistrationOptions* options : {&beside, &alone}) {
    options->momenta.first_order_shear = 1e9;
    options->momenta.regularisation = 3e-5;
  }
  EXPECT_EQ(register_images<2>(input, beside).displacement.samples,
            register_images<2>(input, alone).displacement.samples);
}

// Where first orders begin on the second level, the motion found on the first goes on: of the energy that it begins
// with only order 0's part follows the weight, and in proportion.
TEST(LowContrast, KeepsTheMotionFoundBeforeOrder0GetsAnotherWeight) {
  const RegistrationInput<2> input = pair_of(make_phantom<2>(default_phantom_options(PhantomKind::Slip)));
  const auto energy_at_the_start = [&](double beside) {
    RegistrationOptions options = default_options(Model::Sliding, SimilarityType::Ssd, Preset::Balanced);
    options.pyramid.levels = 2;
    options.momenta.first_order_scales = 1;
    options.momenta.regularisation = 1e-3;
    options.momenta.regularisation_beside_first = beside;
    options.optimisation.max_iterations = 8;
    options.threads = 1;
    return register_images<2>(input, options).summary.levels.at(1).energy_before;
  };
  const double whole = energy_at_the_start(1e-3), half = energy_at_the_start(5e-4),
               quarter = energy_at_the_start(2.5e-4);
  ASSERT_GT(whole - half, 1e-3 * whole);
  EXPECT_NEAR((whole - half) / (half - quarter), 2, 0.01);
}

}  // namespace
}  // namespace saltus
