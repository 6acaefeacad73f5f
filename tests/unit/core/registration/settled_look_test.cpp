// Order 0 that has settled as other rounds have to, and goes on where no slip shows. Oracle: the same registration in
// which it is asked once, when it has gone on.
#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "core/registration/register_images.h"
#include "tests/support/phantom_pair.h"
#include "tests/support/slip_looks.h"

namespace saltus {
namespace {

using testing::asked;
using testing::evaluations;
using testing::first_energies;
using testing::first_iterations;
using testing::kLooksAfter;
using testing::pair_of;
using testing::phantom;

/// Iterations after which a round has settled to `tolerance`, from the energies that it told; -1: it has not.
int settled_after(const RegistrationSummary& summary, const LevelSummary& level, double tolerance) {
  const std::vector<double> energies = first_energies(summary, level);
  for (std::size_t k = 5; k < energies.size(); ++k)
    if (energies[k - 5] - energies[k] <= tolerance * (energies[0] - energies[k])) return static_cast<int>(k);
  return -1;
}

/// Two looks: to 0.05, and from there to 0.005.
RegistrationOptions looking_twice(SimilarityType similarity) {
  RegistrationOptions options = default_options(Model::Auto, similarity, Preset::Balanced);
  options.momenta.plain_shear = 0;
  options.optimisation.tolerance = 0.05;
  options.optimisation.look_tolerance = 0.005;
  options.optimisation.noise_tolerance = 0;
  return options;
}

// Order 0 is asked when it has settled as other rounds have to, and goes on only where no slip shows.
TEST(SettledLook, SavesWhatOrderZeroWouldGoOnWith) {
  const RegistrationInput<2> input = pair_of(phantom<2>(PhantomKind::Slip, 30));
  for (SimilarityType similarity : {SimilarityType::Lncc, SimilarityType::Ssd}) {
    SCOPED_TRACE(to_string(similarity));
    RegistrationOptions options = looking_twice(similarity);
    options.pyramid.levels = 1;
    options.momenta.first_order_shear = 1e9;
    const RegistrationResult<2> alone = register_images<2>(input, options);
    ASSERT_EQ(asked(alone.summary).decision, FirstOrderDecision::LeftOut);
    const int settled = settled_after(alone.summary, asked(alone.summary), 0.05);
    ASSERT_GT(settled, 0);
    ASSERT_GT(first_iterations(alone.summary, asked(alone.summary)), settled);
    options.momenta.first_order_shear = 1e-9;
    const RegistrationResult<2> found = register_images<2>(input, options);
    EXPECT_EQ(asked(found.summary).decision, FirstOrderDecision::LetIn);
    EXPECT_EQ(first_iterations(found.summary, asked(found.summary)), settled);
    for (int k = 0; k < settled; ++k) EXPECT_EQ(found.summary.history[k].energy, alone.summary.history[k].energy) << k;
  }
}

// A level that was asked in vain is the same level: as one that is not asked before it has settled to look_tolerance.
TEST(SettledLook, ChangesNothingWhereNothingShows) {
  for (SimilarityType similarity : {SimilarityType::Lncc, SimilarityType::Mi, SimilarityType::Ssd})
    for (PhantomKind kind : {PhantomKind::Smooth, PhantomKind::Slip}) {
      SCOPED_TRACE(to_string(similarity) + " " + to_string(kind));
      const RegistrationInput<2> input = pair_of(phantom<2>(kind, 30));
      RegistrationOptions options = looking_twice(similarity);
      options.momenta.first_order_shear = 1e9;
      options.momenta.finer_shear = options.momenta.narrower_pull = 0;
      options.momenta.full_contrast = 0;  // by which tolerances follow the contrast
      const RegistrationResult<2> twice = register_images<2>(input, options);
      ASSERT_EQ(asked(twice.summary).decision, FirstOrderDecision::LeftOut);
      const auto first = settled_after(twice.summary, asked(twice.summary), 0.05);
      ASSERT_TRUE(first > 0 && first < first_iterations(twice.summary, asked(twice.summary))) << "nobody looked";
      options.optimisation.tolerance = options.optimisation.look_tolerance;
      const RegistrationResult<2> once = register_images<2>(input, options);
      EXPECT_EQ(asked(once.summary).simple_shear, asked(twice.summary).simple_shear);
      EXPECT_EQ(evaluations(once.summary), evaluations(twice.summary));
      EXPECT_EQ(once.displacement.samples, twice.displacement.samples);
    }
}

// A run that is stopped after a look in vain tells of no shear that anything rested on.
TEST(SettledLook, LeavesNothingBehindWhereNothingShows) {
  const RegistrationInput<2> input = pair_of(phantom<2>(PhantomKind::Slip, 30));
  RegistrationOptions options = looking_twice(SimilarityType::Lncc);
  options.pyramid.levels = 1;
  options.momenta.first_order_shear = options.momenta.plain_shear = 1e9;
  const RegistrationResult<2> whole = register_images<2>(input, options);
  const int settled = settled_after(whole.summary, asked(whole.summary), 0.05);
  ASSERT_GT(first_iterations(whole.summary, asked(whole.summary)), settled);
  for (int after : {kLooksAfter, settled}) {
    SCOPED_TRACE(after);
    const RegistrationResult<2> stopped = register_images<2>(input, options, [&](const Progress& now) {
      return now.iteration > after ? ProgressAnswer::Stop : ProgressAnswer::Continue;
    });
    EXPECT_EQ(stopped.summary.levels[0].iterations, after + 1);
    EXPECT_EQ(stopped.summary.levels[0].decision, FirstOrderDecision::None);
    EXPECT_EQ(stopped.summary.levels[0].simple_shear, 0);
  }
}

// What shows when order 0 has gone on is let in then. How quick it was is told of what brought it to `tolerance`,
// however long it went on.
TEST(SettledLook, IsTakenAgainWhereOrderZeroHasGoneOn) {
  const RegistrationInput<2> input = pair_of(phantom<2>(PhantomKind::Slip));
  RegistrationOptions options = looking_twice(SimilarityType::Lncc);
  options.optimisation.tolerance = 0.02;  // ten iterations are not all of them
  options.pyramid.levels = 1;
  options.momenta.first_order_shear = 1e-9;
  const RegistrationResult<2> early = register_images<2>(input, options);
  options.momenta.first_order_shear = 1e9;
  const RegistrationResult<2> alone = register_images<2>(input, options);
  const double more = asked(alone.summary).simple_shear;
  ASSERT_GT(more, asked(early.summary).simple_shear) << "a scene in which a slip shows more when order 0 has gone on";
  options.momenta.first_order_shear = more;
  const RegistrationResult<2> late = register_images<2>(input, options);
  EXPECT_EQ(asked(late.summary).decision, FirstOrderDecision::LetIn);
  EXPECT_EQ(asked(late.summary).simple_shear, more);
  const int whole = first_iterations(alone.summary, asked(alone.summary));
  EXPECT_EQ(first_iterations(late.summary, asked(late.summary)), whole);
  EXPECT_GT(whole, first_iterations(early.summary, asked(early.summary)));
  EXPECT_GT(asked(early.summary).quick_share, 0);
  EXPECT_EQ(asked(late.summary).quick_share, asked(early.summary).quick_share);
}

}  // namespace
}  // namespace saltus
