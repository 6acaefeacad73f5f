// Oracle: arithmetic; and what a whole run has done when it ends.
#include "core/phantom/make_phantom.h"
#include "core/registration/expected_iterations.h"
#include "core/registration/register_images.h"
#include "core/registration/work_meter.h"
#include "tests/support/phantom_pair.h"

#include <gtest/gtest.h>

namespace saltus {
namespace {

TEST(WorkMeter, CountsWhatIsDoneOfWhatIsExpected) {
  WorkMeter meter;
  meter.plan_step(100);
  meter.plan_step(300);
  EXPECT_EQ(meter.left(), 400);
  EXPECT_EQ(meter.fraction(), 0);
  meter.add(0, 50);
  EXPECT_EQ(meter.left(), 350);
  EXPECT_DOUBLE_EQ(meter.fraction(), 50.0 / 400);
  meter.end(0);  // half of what was planned
  EXPECT_EQ(meter.left(), 300);
  EXPECT_DOUBLE_EQ(meter.fraction(), 50.0 / 350);
  meter.add(1, 150);
  meter.end(1);
  EXPECT_EQ(meter.left(), 0);
  EXPECT_EQ(meter.fraction(), 1);
}

TEST(WorkMeter, StandsStillWhereMoreComesThanWasExpected) {
  WorkMeter meter;
  meter.plan_step(100);
  meter.add(0, 80);
  meter.expect(0, 120);
  EXPECT_EQ(meter.left(), 120);
  EXPECT_DOUBLE_EQ(meter.fraction(), 0.8);
  meter.add(0, 60);
  EXPECT_DOUBLE_EQ(meter.fraction(), 0.8);
  meter.add(0, 40);
  EXPECT_DOUBLE_EQ(meter.fraction(), 0.9);
  meter.add(0, 100);
  EXPECT_EQ(meter.left(), 0);
}

TEST(WorkMeter, TakesStepsOfAnEarlierRunAsPlanned) {
  WorkMeter meter;
  meter.plan_step(100);
  meter.plan_step(300);
  meter.end(0, true);
  EXPECT_DOUBLE_EQ(meter.fraction(), 0.25);
}

TEST(ExpectedIterations, FollowHowTheDecreaseDiesAway) {
  MinimiseOptions how;
  how.max_iterations = 300;
  how.tolerance = 0.01;
  EXPECT_EQ(expected_iterations_left({}, how), usual_iterations);
  EXPECT_EQ(expected_iterations_left({9, 8, 7}, how), usual_iterations - 2);
  // Ten iterations, a decrease of 100 in all and of 9 in the last five: 9 times too much, so 30 iterations in all.
  std::vector<double> energies{200, 170, 150, 130, 115, 109, 107, 105, 103, 101, 100};
  EXPECT_NEAR(expected_iterations_left(energies, how), 20, 1e-9);
  how.max_iterations = 12;
  EXPECT_EQ(expected_iterations_left(energies, how), 2);
  how.max_iterations = 300;
  how.decrease_before = 300;  // of 400, 2.25 %
  EXPECT_NEAR(expected_iterations_left(energies, how), 5, 1e-9);
  how.decrease_before = 0;
  energies.back() = 108.5;  // 0.5 in five iterations: it has settled
  EXPECT_EQ(expected_iterations_left(energies, how), 0);
  energies.back() = 100;
  how.tolerance = 0;
  EXPECT_EQ(expected_iterations_left(energies, how), 290);
}

// Progress is of the work that there is, and not of the limit on iterations, which most levels stay far below.
TEST(Progress, IsOfTheWorkThatIsDone) {
  for (Model model : {Model::Gaussian, Model::Auto, Model::Sliding}) {
    const Phantom<2> phantom = make_phantom<2>(default_phantom_options(PhantomKind::Rectangle));
    RegistrationInput<2> input = testing::pair_of(phantom);
    double last = 0;
    std::vector<double> finest;  // by iteration
    const auto result = register_images<2>(input, default_options(model, SimilarityType::Ssd, Preset::Balanced),
                                           [&](const Progress& now) {
                                             EXPECT_GE(now.fraction, last);
                                             EXPECT_LE(now.fraction, 1);
                                             last = now.fraction;
                                             if (now.level == now.levels) {
                                               finest.resize(static_cast<std::size_t>(now.iteration) + 1, last);
                                             }
                                             return ProgressAnswer::Continue;
                                           });
    ASSERT_NE(result.summary.levels.back().termination, Termination::IterationLimit);
    EXPECT_GT(last, 0.8) << to_string(model);
    // In the middle of the finest level, where nearly all work is, and not at the end long before it.
    EXPECT_GT(finest[finest.size() / 2], 0.3) << to_string(model);
    EXPECT_LT(finest[finest.size() / 2], 0.9) << to_string(model);
  }
}

}  // namespace
}  // namespace saltus
