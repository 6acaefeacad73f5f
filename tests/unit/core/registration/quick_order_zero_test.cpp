// Order 0 that is quick, and gives up what is sharp when first orders are let in. Oracle: the energies that a run
// tells, and the same registration in which order 0 settles, or keeps what it has found.
#include <gtest/gtest.h>

#include <cmath>
#include <utility>
#include <vector>

#include "core/registration/register_images.h"
#include "tests/support/phantom_pair.h"
#include "tests/support/slip_looks.h"

namespace saltus {
namespace {

using testing::add;
using testing::asked;
using testing::body_that_slides;
using testing::evaluations;
using testing::first_energies;
using testing::first_iterations;
using testing::pair_of;
using testing::phantom;
using testing::Sums;

// Order 0 that was quick gives up what is sharp, which first orders are there for. Oracle: the truth, and order 0 that
// keeps what it has found.
TEST(QuickShare, SavesWhatOrderZeroWouldGiveUpLittleByLittle) {
  Sums kept, given_up;
  for (double slip_mm : {4, 6}) {
    const Phantom<3> body = body_that_slides(16, slip_mm);
    for (const auto& [share, weight] : {std::pair(0.0, 0.997), std::pair(0.0, 1.0), std::pair(0.0, 1.003),
                                        std::pair(-1.0, 0.997), std::pair(-1.0, 1.0), std::pair(-1.0, 1.003)}) {
      RegistrationOptions options = default_options(Model::Auto, SimilarityType::Lncc, Preset::Balanced);
      options.momenta.quick_share = share;
      options.momenta.quick_tolerance = 0;
      options.similarity_parameters.weight = weight;  // single runs differ by more than what is asked
      const RegistrationResult<3> found = register_images<3>(pair_of(body), options);
      const LevelSummary& level = asked(found.summary);
      ASSERT_EQ(level.decision, FirstOrderDecision::LetIn);
      EXPECT_EQ(level.gave_up_sharp, share != 0);
      EXPECT_GT(level.quick_share, 0.79);
      EXPECT_LT(level.quick_share, 1);
      add<3>(found, body, share == 0 ? kept : given_up);
    }
  }
  EXPECT_LT(given_up.evaluations, 0.95 * kept.evaluations);
  EXPECT_LT(given_up.error_mm, 1.03 * kept.error_mm);
  EXPECT_LT(given_up.error_near_mm, 1.03 * kept.error_near_mm);
}

// Of order 0 that has not settled nobody knows how much its first iterations had, and one that is stopped before it
// took a step has what it had.
TEST(QuickShare, GivesUpNothingForNothing) {
  RegistrationOptions options = default_options(Model::Auto, SimilarityType::Lncc, Preset::Balanced);
  options.pyramid.levels = 1;
  options.optimisation.tolerance = options.optimisation.look_tolerance;  // ten iterations are not all of them
  options.momenta.first_order_shear = options.momenta.quick_share = 1e-9;
  const RegistrationInput<2> input = pair_of(phantom<2>(PhantomKind::Slip, 30));
  const RegistrationResult<2> whole = register_images<2>(input, options);
  ASSERT_TRUE(asked(whole.summary).gave_up_sharp);
  const int rounds = first_iterations(whole.summary, asked(whole.summary));
  const auto stopped_at = [&](double share, int call) {
    options.momenta.quick_share = share;
    int calls = 0;
    return register_images<2>(input, options, [&](const Progress& now) {
      return now.iteration == rounds && ++calls == call ? ProgressAnswer::Stop : ProgressAnswer::Continue;
    });
  };
  // The last step of order 0 is told, then what is asked of its displacement, then the next round's first evaluation.
  int call = 1;
  while (stopped_at(0, call).summary.levels[0].decision != FirstOrderDecision::LetIn) ASSERT_LT(++call, 100);
  const RegistrationResult<2> kept = stopped_at(0, call), given_up = stopped_at(1e-9, call);
  EXPECT_EQ(kept.summary.termination, Termination::Stopped);
  EXPECT_EQ(asked(given_up.summary).decision, FirstOrderDecision::LetIn);
  EXPECT_FALSE(asked(given_up.summary).gave_up_sharp);
  EXPECT_EQ(given_up.displacement.samples, kept.displacement.samples);
  options.momenta.quick_share = 1e-9;
  options.optimisation.max_iterations = 8;
  const RegistrationResult<2> few = register_images<2>(input, options);
  EXPECT_EQ(asked(few.summary).decision, FirstOrderDecision::LetIn);
  EXPECT_FALSE(asked(few.summary).gave_up_sharp);
  EXPECT_EQ(asked(few.summary).quick_share, -1);
  // Nor of order 0 that has settled in no more than these.
  options.optimisation.max_iterations = 150;
  options.optimisation.tolerance = 0.3;
  const RegistrationResult<2> soon = register_images<2>(input, options);
  EXPECT_EQ(asked(soon.summary).decision, FirstOrderDecision::LetIn);
  EXPECT_LE(first_iterations(soon.summary, asked(soon.summary)), 10);
  EXPECT_FALSE(asked(soon.summary).gave_up_sharp);
  EXPECT_EQ(asked(soon.summary).quick_share, -1);
}

// The share is that of the energies that the round itself tells of.
TEST(QuickShare, IsThatOfTheFirstTenIterations) {
  RegistrationOptions options = default_options(Model::Auto, SimilarityType::Lncc, Preset::Balanced);
  options.pyramid.levels = 1;
  options.optimisation.tolerance = options.optimisation.look_tolerance;  // ten iterations are not all of them
  options.momenta.first_order_shear = 1e-9;
  const RegistrationInput<2> input = pair_of(phantom<2>(PhantomKind::Slip, 30));
  const RegistrationResult<2> found = register_images<2>(input, options);
  const LevelSummary& level = asked(found.summary);
  const int rounds = first_iterations(found.summary, level);
  ASSERT_GT(rounds, 10);
  const auto energy = [&](int iteration) {
    return found.summary.history[static_cast<std::size_t>(iteration) - 1].energy;
  };
  EXPECT_NEAR(level.quick_share, (level.energy_before - energy(10)) / (level.energy_before - energy(rounds)), 1e-12);
  EXPECT_FALSE(level.gave_up_sharp) << "not in 2-D";
  // So much is enough, and no more.
  options.momenta.quick_share = level.quick_share;
  const RegistrationResult<2> smooth = register_images<2>(input, options);
  EXPECT_TRUE(asked(smooth.summary).gave_up_sharp);
  EXPECT_NE(smooth.displacement.samples, found.displacement.samples);
  options.momenta.quick_share = std::nextafter(level.quick_share, 1.0);
  const RegistrationResult<2> same = register_images<2>(input, options);
  EXPECT_FALSE(asked(same.summary).gave_up_sharp);
  EXPECT_EQ(same.displacement.samples, found.displacement.samples);
  // Early nobody knows how quick order 0 is.
  options.momenta.quick_share = 1e-9;
  options.momenta.plain_shear = 1e-9;
  const RegistrationResult<2> early = register_images<2>(input, options);
  EXPECT_TRUE(asked(early.summary).was_plain);
  EXPECT_FALSE(asked(early.summary).gave_up_sharp);
  EXPECT_EQ(asked(early.summary).quick_share, -1);
}

/// What the last five of so many iterations of the first round had of what all had brought. The level was asked.
double share_of_five(const RegistrationSummary& summary, int iterations) {
  const std::vector<double> energies = first_energies(summary, asked(summary));
  const double end = energies.at(static_cast<std::size_t>(iterations));
  return (energies.at(static_cast<std::size_t>(iterations) - 5) - end) / (energies.front() - end);
}

/// One level of a slip in 2-D, which order 0 needs more than ten iterations for.
struct QuickSlip {
  explicit QuickSlip(double angle_deg = 30) : input(pair_of(phantom<2>(PhantomKind::Slip, angle_deg))) {
    options.pyramid.levels = 1;
    options.optimisation.tolerance = options.optimisation.look_tolerance;
    options.momenta.first_order_shear = 1e-9;
  }
  RegistrationResult<2> found(double quick_tolerance) {
    options.momenta.quick_tolerance = quick_tolerance;
    return register_images<2>(input, options);
  }

  RegistrationInput<2> input;
  RegistrationOptions options = default_options(Model::Auto, SimilarityType::Lncc, Preset::Balanced);
};

// The round of order 0 ends where the energies that it tells of say so, and begins smooth beside first orders.
TEST(QuickTolerance, EndsTheRoundWhereFiveIterationsBringSoLittle) {
  QuickSlip slip;
  const RegistrationResult<2> settled = slip.found(0);
  ASSERT_GT(first_iterations(settled.summary, asked(settled.summary)), 10);
  ASSERT_EQ(asked(settled.summary).quick_after, -1);
  for (int after = 6; after < 10; ++after)
    ASSERT_GT(share_of_five(settled.summary, after), share_of_five(settled.summary, after + 1)) << "of such a scene";
  for (int after : {6, 8, 10}) {
    SCOPED_TRACE(after);
    const double share = share_of_five(settled.summary, after);
    for (double tolerance : {share * (1 + 1e-9), share * (1 - 1e-9)}) {
      const RegistrationResult<2> found = slip.found(tolerance);
      const LevelSummary& level = asked(found.summary);
      const int expected = tolerance > share ? after : after + 1;
      if (expected <= 10) {
        EXPECT_EQ(level.quick_after, expected);
        EXPECT_EQ(first_iterations(found.summary, level), expected);
        EXPECT_TRUE(level.gave_up_sharp);
        EXPECT_EQ(level.quick_share, -1);
        EXPECT_EQ(level.decision, FirstOrderDecision::LetIn);
        EXPECT_NE(found.displacement.samples, settled.displacement.samples);
      } else {
        EXPECT_EQ(level.quick_after, -1);
        EXPECT_FALSE(level.gave_up_sharp);
        EXPECT_EQ(evaluations(found.summary), evaluations(settled.summary));
        EXPECT_EQ(found.displacement.samples, settled.displacement.samples);
      }
    }
  }
}

// Asked in vain, order 0 goes on as if it had not been, and is asked how quick it was when a slip shows later.
TEST(QuickTolerance, ChangesNothingWhereNothingShows) {
  QuickSlip slip(0);
  const double early = asked(slip.found(0.9).summary).simple_shear;
  slip.options.momenta.quick_share = 0.5;
  const RegistrationResult<2> settled = slip.found(0);
  const double late = asked(settled.summary).simple_shear;
  ASSERT_LT(early, late) << "a scene in which a slip shows more when order 0 has gone on";
  ASSERT_TRUE(asked(settled.summary).gave_up_sharp);
  slip.options.momenta.first_order_shear = late;
  for (double share : {0.5, 1.0}) {
    SCOPED_TRACE(share);
    slip.options.momenta.quick_share = share;
    const RegistrationResult<2> twice = slip.found(0.9), once = slip.found(0);
    const LevelSummary& level = asked(twice.summary);
    EXPECT_EQ(level.simple_shear, late);
    EXPECT_EQ(level.gave_up_sharp, share < 1);
    EXPECT_EQ(level.quick_after, -1);
    EXPECT_EQ(level.quick_share, asked(once.summary).quick_share);
    EXPECT_EQ(evaluations(twice.summary), evaluations(once.summary));
    EXPECT_EQ(twice.displacement.samples, once.displacement.samples);
  }
  slip.options.momenta.first_order_shear = 1e9;
  const RegistrationResult<2> in_vain = slip.found(0.9), alone = slip.found(0);
  EXPECT_EQ(asked(in_vain.summary).decision, FirstOrderDecision::LeftOut);
  EXPECT_EQ(asked(in_vain.summary).quick_after, -1);
  EXPECT_EQ(asked(in_vain.summary).simple_shear, asked(alone.summary).simple_shear);
  EXPECT_EQ(evaluations(in_vain.summary), evaluations(alone.summary));
  EXPECT_EQ(in_vain.displacement.samples, alone.displacement.samples);
}

// Quick is what ended the round, and within ten iterations: not that it was so before, when nothing showed, nor that it
// has settled to as much later.
TEST(QuickTolerance, CountsWhereTheRoundEnds) {
  QuickSlip slip(0);
  const RegistrationSummary whole = slip.found(0).summary;
  const double tolerance = slip.options.optimisation.tolerance;
  ASSERT_GT(first_iterations(whole, asked(whole)), 10);
  for (int after = 6; after < 9; ++after) ASSERT_GT(share_of_five(whole, after), share_of_five(whole, after + 1));
  const double at_six = share_of_five(whole, 6) * (1 + 1e-9), at_nine = share_of_five(whole, 9) * (1 + 1e-9);
  const double early = asked(slip.found(at_six).summary).simple_shear;
  const double late = asked(slip.found(at_nine).summary).simple_shear;
  ASSERT_LT(early, late);
  slip.options.momenta.first_order_shear = late;
  slip.options.optimisation.tolerance = at_nine;
  const RegistrationSummary in_vain_before = slip.found(at_six).summary;
  EXPECT_EQ(first_iterations(in_vain_before, asked(in_vain_before)), 9);
  EXPECT_EQ(asked(in_vain_before).decision, FirstOrderDecision::LetIn);
  EXPECT_EQ(asked(in_vain_before).quick_after, -1);
  EXPECT_FALSE(asked(in_vain_before).gave_up_sharp);
  slip.options.momenta.first_order_shear = 1e-9;
  slip.options.optimisation.tolerance = tolerance;
  const RegistrationSummary settled = slip.found(tolerance).summary;
  EXPECT_EQ(first_iterations(settled, asked(settled)), first_iterations(whole, asked(whole)));
  EXPECT_EQ(asked(settled).quick_after, -1);
  EXPECT_EQ(asked(settled).quick_share, asked(whole).quick_share);
  EXPECT_FALSE(asked(settled).gave_up_sharp);
}

// At its limit of iterations order 0 is as quick as it has been by then.
TEST(QuickTolerance, IsNotWaitedForBeyondTheLimitOfIterations) {
  QuickSlip slip;
  slip.options.optimisation.max_iterations = 8;
  const double share = share_of_five(slip.found(0).summary, 8);
  const RegistrationResult<2> quick = slip.found(share * (1 + 1e-9)), slow = slip.found(share * (1 - 1e-9));
  EXPECT_EQ(asked(quick.summary).quick_after, 8);
  EXPECT_TRUE(asked(quick.summary).gave_up_sharp);
  EXPECT_EQ(asked(slow.summary).quick_after, -1);
  EXPECT_FALSE(asked(slow.summary).gave_up_sharp);
  EXPECT_EQ(asked(slow.summary).decision, FirstOrderDecision::LetIn);
}

// Around a body that slides order 0 need not settle first. Oracle: the truth, and order 0 that settles and then gives
// up what is sharp, or goes on from it where that is what it does.
TEST(QuickTolerance, SavesWhatOrderZeroWouldGiveUp) {
  for (SimilarityType similarity : {SimilarityType::Lncc, SimilarityType::Mind}) {
    SCOPED_TRACE(to_string(similarity));
    Sums settled, quick;
    for (const auto& [radius_mm, slip_mm] : {std::pair(16, 4), std::pair(16, 6), std::pair(20, 4), std::pair(20, 6)}) {
      const Phantom<3> body = body_that_slides(radius_mm, slip_mm);
      for (double tolerance : {0.0, -1.0})
        for (double weight : {0.997, 1.003}) {  // single runs differ by more than what is asked
          RegistrationOptions options = default_options(Model::Auto, similarity, Preset::Balanced);
          options.momenta.quick_tolerance = tolerance;
          options.similarity_parameters.weight = weight;
          const RegistrationResult<3> found = register_images<3>(pair_of(body), options);
          const LevelSummary& level = asked(found.summary);
          ASSERT_EQ(level.decision, FirstOrderDecision::LetIn);
          EXPECT_TRUE(level.gave_up_sharp);
          EXPECT_EQ(level.quick_after > 0, tolerance != 0);
          add<3>(found, body, tolerance == 0 ? settled : quick);
        }
    }
    EXPECT_LT(quick.evaluations, 0.9 * settled.evaluations);
    EXPECT_LT(quick.error_mm, 1.03 * settled.error_mm);
    EXPECT_LT(quick.error_near_mm, 1.03 * settled.error_near_mm);
  }
}

}  // namespace
}  // namespace saltus
