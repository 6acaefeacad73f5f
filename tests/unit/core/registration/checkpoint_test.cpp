// Oracle: the same registration without an interruption.
#include "core/registration/checkpoint.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <sstream>

#include "core/registration/register_images.h"
#include "core/support/errors.h"
#include "tests/support/analytic_scene.h"
#include "tests/support/checkpoint_bytes.h"
#include "tests/support/same_result.h"

namespace saltus {
namespace {

using testing::AnalyticScene;
using testing::centred_grid;
using testing::expect_same_bits;
using ::testing::HasSubstr;
using testing::sampled;

template <int Dim>
RegistrationInput<Dim> pair_of(const ImageGrid<Dim>& grid) {
  const AnalyticScene<Dim> scene(10, 2.5, 50, 5);
  RegistrationInput<Dim> input;
  input.moving = sampled<Dim>(grid, scene);
  input.fixed = sampled<Dim>(grid, [&](Vector<Dim> x) {
    x[1] += x[0] > 0 ? 1.5 : -1.5;
    return scene(x);
  });
  return input;
}

RegistrationInput<2> plane() { return pair_of<2>(centred_grid<2>({30, 26}, {1, 1}, Matrix<2>::Identity())); }

RegistrationOptions quick(SimilarityType similarity = SimilarityType::Ssd) {
  RegistrationOptions options = default_options(Model::Sliding, similarity, Preset::Balanced);
  options.pyramid.levels = 2;
  options.pyramid.finest_level = 0;
  options.momenta.width_voxels = 5;
  options.momenta.scales = 2;
  options.optimisation.max_iterations = 7;
  options.optimisation.tolerance = options.optimisation.optimality_tolerance = 0;
  options.momenta.sparsity_path = 1;
  options.momenta.reweighted_rounds = 0;
  options.momenta.debias = false;
  options.threads = 1;
  return options;
}

/// Runs until `accepted` steps were taken, in all levels, and gives the checkpoint of the last.
template <int Dim>
std::string stopped_after(const RegistrationInput<Dim>& input, const RegistrationOptions& options, int accepted,
                          const std::string& resume = {}) {
  std::string blob;
  int steps = 0;
  bool is_enough = false;
  const RegistrationResult<Dim> result = register_images<Dim>(
      input, options, [&](const Progress&) { return is_enough ? ProgressAnswer::Stop : ProgressAnswer::Continue; },
      {.resume = from(resume), .offer = [&](const Progress&, const MakeCheckpoint& make) {
         if (++steps < accepted) return;
         blob = bytes_of(make);
         is_enough = true;
       }});
  EXPECT_EQ(result.summary.termination, Termination::Stopped);
  return blob;
}

template <int Dim>
void resumes_anywhere(const RegistrationInput<Dim>& input, RegistrationOptions options) {
  const RegistrationResult<Dim> whole = register_images<Dim>(input, options);
  const int steps = static_cast<int>(whole.summary.history.size());
  ASSERT_GT(steps, 9);
  for (int k = 1; k <= steps; ++k) {
    SCOPED_TRACE(k);
    options.threads = 1 + k % 2;
    const std::string blob = stopped_after<Dim>(input, options, k);
    options.threads = 1 + k / 2 % 2;
    expect_same_bits(register_images<Dim>(input, options, {}, {.resume = from(blob), .offer = {}}), whole);
  }
}

TEST(Checkpoint, ResumesAtAnyStepWithTheSameEnd2d) {
  resumes_anywhere<2>(plane(), quick());
  resumes_anywhere<2>(plane(), quick(SimilarityType::Lncc));
}

// The weights of a round come from where it began, which is gone when it is taken up again.
TEST(Checkpoint, ResumesInAnyRoundWithTheSameEnd) {
  RegistrationOptions options = quick();
  options.optimisation.max_iterations = 4;
  options.momenta.sparsity_path = 2;
  options.momenta.reweighted_rounds = 1;
  options.momenta.debias = true;
  for (bool keeps : {false, true}) {
    options.optimisation.keep_pairs = keeps;
    resumes_anywhere<2>(plane(), options);
  }
}

// What the first step of each round of a level leaves behind: one pair where the round began without any. It does where
// it is the first of its level or the first in which first orders join, and everywhere where pairs are not kept.
TEST(Checkpoint, HoldsTheCurvatureOfTheRoundBefore) {
  for (const auto& [waits, keeps] :
       std::vector<std::pair<bool, bool>>{{true, true}, {false, true}, {true, false}, {false, false}}) {
    RegistrationOptions options = quick();
    options.momenta.first_order_waits = waits;
    options.optimisation.keep_pairs = keeps;
    options.momenta.reweighted_rounds = 2;
    options.flow.coarsening = 0;
    const RegistrationInput<2> input = plane();
    std::vector<std::vector<std::size_t>> pairs(2);  // by level and round
    register_images<2>(input, options, {},
                       {.resume = {}, .offer = [&](const Progress&, const MakeCheckpoint& make) {
                          std::istringstream in(bytes_of(make));
                          const Checkpoint at = decode(in, job_fingerprint(input, options));
                          if (at.minimiser.iterations() == 1)
                            pairs.at(static_cast<std::size_t>(at.step)).push_back(at.minimiser.pairs.size());
                        }});
    for (const std::vector<std::size_t>& rounds : pairs) {
      ASSERT_GE(rounds.size(), waits ? 3u : 2u);
      for (std::size_t round = 0; round < rounds.size(); ++round)
        EXPECT_EQ(rounds[round] > 1, keeps && round > (waits ? 1u : 0u)) << waits << ' ' << keeps << ' ' << round;
    }
  }
}

TEST(Checkpoint, IsRefusedWhereItIsOfARoundThatThereIsNot) {
  const RegistrationOptions options = quick();
  const std::uint64_t job = job_fingerprint(plane(), options);
  Checkpoint reached = decoded(stopped_after<2>(plane(), options, 3), job);
  reached.level.rounds = 40;
  try {
    register_images<2>(plane(), options, {}, {.resume = from(encoded(reached, job)), .offer = {}});
    FAIL() << "it went on";
  } catch (const InvalidInput& refused) {
    EXPECT_THAT(refused.what(), HasSubstr("round 40"));
  }
}

// With lncc as it is by default: kernels are sums of widths, whose shares follow the noise, and the weights of the last
// round come from the momenta of the one before.
TEST(Checkpoint, ResumesInAReweightedRoundWithSumsOfWidthsWithTheSameEnd) {
  RegistrationOptions options = default_options(Model::Sliding, SimilarityType::Lncc, Preset::Balanced);
  options.pyramid.levels = 2;
  options.pyramid.finest_level = 0;
  options.momenta.sparsity = 1e-3;
  options.optimisation.max_iterations = 6;
  options.optimisation.tolerance = options.optimisation.optimality_tolerance = 0;
  const RegistrationResult<2> whole = register_images<2>(plane(), options);
  ASSERT_EQ(whole.options.momenta.kernel_widths.size(), 2u);
  ASSERT_EQ(whole.summary.levels.back().rounds, 3);
  ASSERT_GT(whole.summary.levels.back().active_block_share, 0);
  const auto is_in_last_round = [](const IterationRecord& step) { return step.level == 2 && step.round == 3; };
  ASSERT_GT(std::count_if(whole.summary.history.begin(), whole.summary.history.end(), is_in_last_round), 2);
  resumes_anywhere<2>(plane(), options);
}

// Order 0 settles on its own coarser lattice, then blocks join on the images', and the level settles again: that
// depends on what the round before brought.
TEST(Checkpoint, ResumesWhereFirstOrdersHaveWaitedWithTheSameEnd) {
  RegistrationOptions options = quick(SimilarityType::Lncc);
  options.optimisation.max_iterations = 20;
  options.optimisation.tolerance = 0.05;
  options.momenta.sparsity = 1e-3;
  const RegistrationResult<2> whole = register_images<2>(plane(), options);
  ASSERT_GT(whole.summary.levels.back().active_block_share, 0.2);
  ASSERT_EQ(whole.summary.levels.back().rounds, 2);
  for (const LevelSummary& level : whole.summary.levels) ASSERT_EQ(level.termination, Termination::Settled);
  resumes_anywhere<2>(plane(), options);
}

// What was kept out before the checkpoint counts, too.
TEST(Checkpoint, ResumesWhereBlocksAreKeptOutWithTheSameEnd) {
  RegistrationOptions options = quick(SimilarityType::Lncc);
  options.momenta.sparsity = 1e-3;
  options.momenta.most_active_share = 0.05;
  const RegistrationResult<2> whole = register_images<2>(plane(), options);
  ASSERT_GT(whole.summary.levels.back().kept_out_share, 0);
  resumes_anywhere<2>(plane(), options);
}

// Where first orders are asked for after order 0 alone, and let in: after it, or from where the level began.
RegistrationOptions asking(SimilarityType similarity, double shear) {
  RegistrationOptions options = quick(similarity);
  options.optimisation.max_iterations = 6;
  options.momenta.sparsity = similarity == SimilarityType::Lncc ? 1e-3 : 1e-5;
  options.momenta.first_order_shear = shear;
  return options;
}

/// Of the first level that has order 1: with ssd the coarser one, which decides for both if it lets them in.
const LevelSummary& asked_of(const RegistrationResult<2>& whole, SimilarityType similarity) {
  return whole.summary.levels[similarity == SimilarityType::Ssd ? 0 : 1];
}

TEST(Checkpoint, ResumesWhereFirstOrdersWereAskedForWithTheSameEnd) {
  for (SimilarityType similarity : {SimilarityType::Lncc, SimilarityType::Ssd})
    for (double shear : {1e-9, 1e9}) {
      SCOPED_TRACE(to_string(similarity) + " " + std::to_string(shear));
      const RegistrationOptions options = asking(similarity, shear);
      const RegistrationResult<2> whole = register_images<2>(plane(), options);
      const LevelSummary& asked = asked_of(whole, similarity);
      ASSERT_EQ(asked.decision, shear < 1 ? FirstOrderDecision::LetIn : FirstOrderDecision::LeftOut);
      ASSERT_EQ(asked.rounds, shear < 1 ? 2 : 1);
      ASSERT_EQ(whole.summary.levels.back().decision == FirstOrderDecision::LeftOut, shear > 1);
      ASSERT_EQ(whole.summary.levels.back().active_block_share > 0, shear < 1);
      resumes_anywhere<2>(plane(), options);
    }
}

// Let in on the level before, and on the finest one with the flow where they are.
TEST(Checkpoint, ResumesWhereImagesAreFinerThanFirstOrdersWithTheSameEnd) {
  RegistrationOptions options = asking(SimilarityType::Lncc, 1e-9);
  options.momenta.first_order_finest_scale = 1;
  ASSERT_EQ(options.flow.coarsening, 1);
  const RegistrationResult<2> whole = register_images<2>(plane(), options);
  ASSERT_EQ(whole.summary.levels.front().decision, FirstOrderDecision::LetIn);
  ASSERT_GT(whole.summary.levels.back().active_block_share, 0);
  resumes_anywhere<2>(plane(), options);
}

// Asked when it has settled to `tolerance` and, in vain, again when it has gone on, with first orders let in by either
// look or by none. Between the looks five iterations may bring more than `tolerance` again: nobody asks then.
TEST(Checkpoint, ResumesWhereASlipIsLookedForTwiceWithTheSameEnd) {
  for (SimilarityType similarity : {SimilarityType::Lncc, SimilarityType::Ssd}) {
    RegistrationOptions options = asking(similarity, 1e-9);
    options.optimisation.max_iterations = 24;
    options.optimisation.tolerance = 0.3;
    options.optimisation.look_tolerance = 0.03;
    const double early = asked_of(register_images<2>(plane(), options), similarity).simple_shear;
    options.momenta.first_order_shear = 1e9;
    const double late = asked_of(register_images<2>(plane(), options), similarity).simple_shear;
    ASSERT_LT(early, late) << "a slip that the first look does not see, and the second does";
    for (double shear : {1e-9, (early + late) / 2, 1e9}) {
      SCOPED_TRACE(to_string(similarity) + " " + std::to_string(shear));
      options.momenta.first_order_shear = shear;
      const LevelSummary found = asked_of(register_images<2>(plane(), options), similarity);
      EXPECT_EQ(found.decision, shear < late ? FirstOrderDecision::LetIn : FirstOrderDecision::LeftOut);
      EXPECT_EQ(found.simple_shear, shear < early ? early : late);
      resumes_anywhere<2>(plane(), options);
    }
  }
}

// It begins smooth beside first orders once, not again where it is taken up.
TEST(Checkpoint, ResumesWhereOrder0GaveUpWhatIsSharpWithTheSameEnd) {
  RegistrationOptions options = asking(SimilarityType::Lncc, 1e-9);
  options.momenta.quick_share = 1e-9;
  options.momenta.reweighted_rounds = 1;  // one more round, in which it does not
  options.optimisation.max_iterations = 40;
  options.optimisation.tolerance = 0.01;  // it is at rest before that, after more than ten
  options.optimisation.look_tolerance = 0;
  const RegistrationResult<2> whole = register_images<2>(plane(), options);
  ASSERT_TRUE(asked_of(whole, SimilarityType::Lncc).gave_up_sharp);
  ASSERT_EQ(asked_of(whole, SimilarityType::Lncc).rounds, 3);
  resumes_anywhere<2>(plane(), options);
}

// As soon as that is known, or asked in vain by then.
TEST(Checkpoint, ResumesWhereOrder0IsQuickWithTheSameEnd) {
  RegistrationOptions options = asking(SimilarityType::Lncc, 1e-9);
  options.momenta.quick_tolerance = 0.9;
  options.optimisation.max_iterations = 40;
  options.optimisation.tolerance = 0.01;
  options.optimisation.look_tolerance = 0;
  const LevelSummary quick = asked_of(register_images<2>(plane(), options), SimilarityType::Lncc);
  ASSERT_GE(quick.quick_after, 6);
  ASSERT_TRUE(quick.gave_up_sharp);
  options.momenta.quick_tolerance = 0;
  const LevelSummary settled = asked_of(register_images<2>(plane(), options), SimilarityType::Lncc);
  ASSERT_GT(settled.iterations, quick.quick_after);
  ASSERT_GT(settled.simple_shear, quick.simple_shear) << "a slip that shows more when order 0 has gone on";
  options.momenta.quick_tolerance = 0.9;
  options.momenta.quick_share = 1e-9;
  for (double shear : {1e-9, quick.simple_shear * (1 + 1e-6)}) {
    SCOPED_TRACE(shear);
    options.momenta.first_order_shear = shear;
    ASSERT_TRUE(asked_of(register_images<2>(plane(), options), SimilarityType::Lncc).gave_up_sharp);
    resumes_anywhere<2>(plane(), options);
  }
  // Not after ten iterations, wherever it is taken up.
  options.momenta.first_order_shear = 1e-9;
  options.momenta.quick_tolerance = 0.2;
  ASSERT_GT(asked_of(register_images<2>(plane(), options), SimilarityType::Lncc).iterations, 11);
  ASSERT_EQ(asked_of(register_images<2>(plane(), options), SimilarityType::Lncc).quick_after, -1);
  resumes_anywhere<2>(plane(), options);
  options.momenta.quick_tolerance = 0.9;
  // In vain early, when quick, when settled and in the end.
  options.momenta.plain_shear = options.momenta.first_order_shear = 1e9;
  options.optimisation.look_tolerance = options.optimisation.tolerance / 2;
  ASSERT_EQ(asked_of(register_images<2>(plane(), options), SimilarityType::Lncc).decision, FirstOrderDecision::LeftOut);
  resumes_anywhere<2>(plane(), options);
}

// Asked early, and the round over (with lncc order 0 goes on in the next one) or, asked in vain, going on: also where
// there is enough shear later, when nobody asks. What order 0 weighs from then on, on finer levels too, depends on it.
TEST(Checkpoint, ResumesWhereASlipIsLookedForEarlyWithTheSameEnd) {
  for (SimilarityType similarity : {SimilarityType::Lncc, SimilarityType::Ssd}) {
    RegistrationOptions options = asking(similarity, 1e-9);
    const double alone = register_images<2>(plane(), options).options.momenta.regularisation;
    options.momenta.regularisation_beside_first = 2 * alone;
    options.momenta.regularisation_beside_plain = 5 * alone;
    options.momenta.plain_shear = 1e-9;
    const double early = asked_of(register_images<2>(plane(), options), similarity).simple_shear;
    for (double shear : {1e-9, early * (1 + 1e-6), 1e9}) {
      SCOPED_TRACE(to_string(similarity) + " " + std::to_string(shear));
      options.momenta.plain_shear = shear;
      const RegistrationResult<2> whole = register_images<2>(plane(), options);
      ASSERT_EQ(asked_of(whole, similarity).decision, FirstOrderDecision::LetIn);
      ASSERT_EQ(asked_of(whole, similarity).was_plain, shear < early);
      if (similarity == SimilarityType::Ssd && shear > early) {
        ASSERT_GT(asked_of(whole, similarity).simple_shear, early * (1 + 1e-6));
      }
      resumes_anywhere<2>(plane(), options);
      options.momenta.settled_plain_shear = 1e-9;
      resumes_anywhere<2>(plane(), options);
      options.momenta.settled_plain_shear = 0;
    }
  }
}

// Order 0 gets another weight as soon as first orders are there, and other momenta for it.
TEST(Checkpoint, ResumesWhereOrder0HasAnotherWeightBesideFirstOrdersWithTheSameEnd) {
  for (double shear : {0.0, 1e-9}) {
    SCOPED_TRACE(shear);
    RegistrationOptions options = quick();
    options.optimisation.max_iterations = 6;
    options.momenta.sparsity = 1e-5;
    options.momenta.first_order_shear = shear;
    const RegistrationResult<2> alike = register_images<2>(plane(), options);
    options.momenta.regularisation_beside_first = alike.options.momenta.regularisation / 4;
    EXPECT_NE(register_images<2>(plane(), options).summary.levels.back().energy_after,
              alike.summary.levels.back().energy_after);
    resumes_anywhere<2>(plane(), options);
  }
}

// Order 0 that is left alone on the finest level gets scales of its own, and gives them up where something slides after
// all.
TEST(Checkpoint, ResumesWhereOrder0HasFinerScalesWithTheSameEnd) {
  for (double shear : {1e-9, 1e9}) {
    SCOPED_TRACE(shear);
    RegistrationOptions options = quick();
    options.optimisation.max_iterations = 4;
    options.momenta.finest_scale = 1;
    options.momenta.sparsity = 1e-5;
    options.momenta.first_order_shear = 1e9;
    options.momenta.finer_shear = shear;
    const RegistrationResult<2> whole = register_images<2>(plane(), options);
    const LevelSummary& finest = whole.summary.levels.back();
    ASSERT_TRUE(finest.has_finer);
    ASSERT_FALSE(whole.summary.levels.front().has_finer);
    ASSERT_EQ(finest.decision, shear < 1 ? FirstOrderDecision::LetIn : FirstOrderDecision::LeftOut);
    resumes_anywhere<2>(plane(), options);
  }
}

// Order 0 that stays alone may get a narrower scale in the end, with finer scales before it or without.
TEST(Checkpoint, ResumesWhereOrder0HasANarrowerScaleWithTheSameEnd) {
  for (SimilarityType similarity : {SimilarityType::Ssd, SimilarityType::Lncc}) {
    SCOPED_TRACE(to_string(similarity));
    const bool is_ssd = similarity == SimilarityType::Ssd;
    RegistrationOptions options = quick(similarity);
    options.optimisation.max_iterations = 8;
    options.optimisation.tolerance = 0.9;  // it is asked where order 0 has settled
    options.momenta.finest_scale = 1;
    options.momenta.sparsity = is_ssd ? 1e-5 : 1e-3;
    options.momenta.first_order_shear = 1e9;
    options.momenta.finer_shear = is_ssd ? 1e9 : 0;
    options.momenta.first_order_waits = !is_ssd;
    options.momenta.narrower_pull = 1e-9;
    options.flow.map_steps = 2;
    options.flow.map_tolerance = 10;
    const RegistrationResult<2> whole = register_images<2>(plane(), options);
    // With finer scales on the finest level, else on that of the finest scale.
    const LevelSummary &coarse = whole.summary.levels.front(), &finest = whole.summary.levels.back();
    const LevelSummary &with = is_ssd ? finest : coarse, &other = is_ssd ? coarse : finest;
    ASSERT_TRUE(with.has_narrower) << with.narrow_pull << " " << with.own_pull;
    ASSERT_FALSE(other.has_narrower);
    ASSERT_EQ(finest.has_finer, is_ssd);
    ASSERT_EQ(with.rounds, is_ssd ? 3 : 2);
    ASSERT_EQ(with.map_steps, is_ssd ? 3 : 4) << "half as many again where the flow has closer sites, else twice";
    resumes_anywhere<2>(plane(), options);
  }
}

// The narrower scale of a level stays when first orders are let in on the next, with another weight of order 0.
TEST(Checkpoint, ResumesWhereFirstOrdersComeAfterANarrowerScaleWithTheSameEnd) {
  RegistrationOptions options = quick(SimilarityType::Lncc);
  options.optimisation.max_iterations = 8;
  options.optimisation.tolerance = 0.9;
  options.momenta.finest_scale = 1;
  options.momenta.sparsity = 1e-5;
  options.momenta.first_order_waits = true;
  options.momenta.regularisation_beside_first = 3 * options.momenta.regularisation;
  options.momenta.narrower_pull = 1e-9;
  options.momenta.first_order_shear = 1e9;
  const auto levels_of = [&] { return register_images<2>(plane(), options).summary.levels; };
  // More than the coarser level shows, which has no first orders and does not tell, and less than the finer one.
  options.momenta.first_order_shear = 0.99 * levels_of().back().simple_shear;
  const std::vector<LevelSummary> levels = levels_of();
  ASSERT_TRUE(levels.front().has_narrower);
  ASSERT_EQ(levels.back().decision, FirstOrderDecision::LetIn);
  ASSERT_GT(levels.back().active_block_share, 0);
  const auto scales_of_order_0 = [&] {
    const auto momenta = register_images<2>(plane(), options).momenta;
    return std::count_if(momenta.begin(), momenta.end(),
                         [](const auto& field) { return field.axis == MomentumField<2>::kZeroth; });
  };
  EXPECT_EQ(scales_of_order_0(), 3);
  resumes_anywhere<2>(plane(), options);
}

// What narrow widths count is found on the level before the finest scale begins, and is of all that come after, until
// first orders are let in.
TEST(Checkpoint, ResumesWhereNarrowWidthsCountLessWithTheSameEnd) {
  for (double shear : {1e-9, 1e9})
    for (int finest_scale : {0, 1}) {
      SCOPED_TRACE(std::to_string(shear) + ", finest scale " + std::to_string(finest_scale));
      RegistrationOptions options = quick(SimilarityType::Lncc);
      options.optimisation.max_iterations = 5;
      options.pyramid.levels = 3;
      options.momenta.finest_scale = finest_scale;
      options.momenta.width_voxels = 0;
      options.momenta.kernel_widths = {{9, 1}, {4, 2}};
      options.momenta.sparsity = 1e-3;
      options.momenta.first_order_shear = shear;
      RegistrationOptions smooth = options;
      smooth.momenta.narrow_width_shear = 1e9;
      const RegistrationResult<2> whole = register_images<2>(plane(), smooth);
      const auto& levels = whole.summary.levels;
      ASSERT_EQ(levels.size(), finest_scale + 2u);
      for (std::size_t k = 0; k < levels.size(); ++k) {
        ASSERT_EQ(levels[k].narrow_share < 1, k == 1) << k;
        ASSERT_EQ(levels[k].shear_before >= 0, k == 1) << k;
      }
      ASSERT_NE(levels.back().energy_after, register_images<2>(plane(), options).summary.levels.back().energy_after);
      resumes_anywhere<2>(plane(), smooth);
    }
}

TEST(Checkpoint, ResumesAtAnyStepWithTheSameEnd3d) {
  RegistrationInput<3> input = pair_of<3>(centred_grid<3>({14, 12, 8}, {1, 1, 1.5}, Matrix<3>::Identity()));
  input.fixed_mask = Volume<3>(input.fixed.grid, 1.0f);
  for (std::size_t i = 0; i < 150; ++i) input.fixed_mask->samples[i] = 0;
  resumes_anywhere<3>(input, quick());
}

TEST(Checkpoint, ResumesWhatWasResumed) {
  const RegistrationInput<2> input = plane();
  const RegistrationResult<2> whole = register_images<2>(input, quick());
  std::string blob;
  for (int stop = 0; stop < 4; ++stop) blob = stopped_after<2>(input, quick(), 2, blob);
  const RegistrationResult<2> end = register_images<2>(input, quick(), {}, {.resume = from(blob), .offer = {}});
  expect_same_bits(end, whole);
}

TEST(Checkpoint, TellsProgressFromWhereItGoesOn) {
  const RegistrationInput<2> input = plane();
  const std::string blob = stopped_after<2>(input, quick(), 10);
  bool is_first = true;
  double last = 0;
  register_images<2>(input, quick(),
                     [&](const Progress& now) {
                       if (is_first) {
                         EXPECT_EQ(now.level, 2);
                         EXPECT_EQ(now.iteration, 3);
                         EXPECT_GT(now.energy, 0);
                       }
                       is_first = false;
                       EXPECT_GE(now.fraction, last);
                       last = now.fraction;
                       return ProgressAnswer::Continue;
                     },
                     {.resume = from(blob), .offer = {}});
  EXPECT_FALSE(is_first);
}

/// What register_images says to a checkpoint, before any work.
template <int Dim>
std::string refusal(const RegistrationInput<Dim>& input, const RegistrationOptions& options, const std::string& blob) {
  try {
    register_images<Dim>(input, options,
                         [](const Progress&) {
                           ADD_FAILURE() << "work began";
                           return ProgressAnswer::Stop;
                         },
                         {.resume = from(blob), .offer = {}});
  } catch (const InvalidInput& error) {
    return error.what();
  }
  return "accepted";
}

TEST(Checkpoint, RefusesWhatIsDamaged) {
  const RegistrationInput<2> input = plane();
  const std::string blob = stopped_after<2>(input, quick(), 2);
  EXPECT_THAT(refusal<2>(input, quick(), "short"), HasSubstr("5 bytes"));
  EXPECT_THAT(refusal<2>(input, quick(), std::string(blob.size(), 'x')),
              HasSubstr("not one that register_images made"));
  for (std::size_t length : {std::size_t(40), blob.size() / 2, blob.size() - 1})
    EXPECT_THAT(refusal<2>(input, quick(), blob.substr(0, length)), HasSubstr("cut off")) << length;
  EXPECT_THAT(refusal<2>(input, quick(), blob + "x"), HasSubstr("cut off, it has"));
  std::string changed = blob;
  changed[8] = 99;
  EXPECT_THAT(refusal<2>(input, quick(), changed), HasSubstr("version 99"));
  for (std::size_t at : {std::size_t(40), blob.size() / 3, blob.size() - 1}) {
    changed = blob;
    changed[at] = static_cast<char>(changed[at] ^ 4);
    EXPECT_THAT(refusal<2>(input, quick(), changed), HasSubstr("its checksum does not match; start again")) << at;
  }
}

TEST(Checkpoint, RefusesThatOfAnotherJob) {
  const RegistrationInput<2> input = plane();
  const std::string blob = stopped_after<2>(input, quick(), 2);
  RegistrationInput<2> other = input;
  other.moving.samples[77] += 1e-4f;
  EXPECT_THAT(refusal<2>(other, quick(), blob), HasSubstr("belongs to another registration"));
  other = input;
  other.fixed.grid.spacing[0] = std::nextafter(1.0, 2.0);
  EXPECT_THAT(refusal<2>(other, quick(), blob), HasSubstr("belongs to another registration"));
  other = input;
  other.fixed_mask = Volume<2>(input.fixed.grid, 1.0f);
  EXPECT_THAT(refusal<2>(other, quick(), blob), HasSubstr("belongs to another registration"));
  other = input;
  other.start.offset[1] = 1e-9;
  EXPECT_THAT(refusal<2>(other, quick(), blob), HasSubstr("belongs to another registration"));
  RegistrationOptions options = quick();
  options.momenta.sparsity = std::nextafter(options.momenta.sparsity, 1.0);
  EXPECT_THAT(refusal<2>(input, options, blob), HasSubstr("belongs to another registration"));
  options = quick();
  options.momenta.full_contrast *= 1.5;  // which is resolved with what the images turn out to be
  EXPECT_THAT(refusal<2>(input, options, blob), HasSubstr("belongs to another registration"));
  options = quick(SimilarityType::Lncc);
  EXPECT_THAT(refusal<2>(input, options, blob), HasSubstr("belongs to another registration"));
}

TEST(Checkpoint, RefusesThatOfAnotherDirectionField) {
  RegistrationInput<2> input = plane();
  VectorVolume<2>& direction = input.direction.emplace(input.fixed.grid);
  std::fill_n(direction.component(0), input.fixed.grid.voxels(), 1.0f);
  RegistrationOptions options = default_options(Model::Directional, SimilarityType::Ssd, Preset::Balanced);
  options.pyramid.levels = 1;
  options.momenta.width_voxels = 5;
  options.momenta.scales = 1;
  options.optimisation.max_iterations = 4;
  const std::string blob = stopped_after<2>(input, options, 2);
  expect_same_bits(register_images<2>(input, options, {}, {.resume = from(blob), .offer = {}}),
                   register_images<2>(input, options));
  RegistrationInput<2> other = input;
  other.direction->component(0)[77] = 0;
  EXPECT_THAT(refusal<2>(other, options, blob), HasSubstr("belongs to another registration"));
}

}  // namespace
}  // namespace saltus
