// Slips that are plain before order 0 has settled. Oracle: the same registration in which order 0 always settles.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "core/phantom/make_phantom.h"
#include "core/registration/register_images.h"
#include "core/registration/scales.h"
#include "core/registration/simple_shear.h"
#include "tests/support/phantom_pair.h"
#include "tests/support/slip_looks.h"

namespace saltus {
namespace {

using testing::add;
using testing::asked;
using testing::body_that_slides;
using testing::evaluations;
using testing::first_iterations;
using testing::kLooksAfter;
using testing::pair_of;
using testing::phantom;
using testing::Sums;

// With ssd first orders begin where the level began, whatever order 0 has done before.
TEST(PlainShear, SavesWhatIsGivenUpAnyhow) {
  const RegistrationInput<2> input = pair_of(phantom<2>(PhantomKind::Slip, 30));
  RegistrationOptions options = default_options(Model::Auto, SimilarityType::Ssd, Preset::Balanced);
  const RegistrationResult<2> found = register_images<2>(input, options);
  const LevelSummary& level = asked(found.summary);
  EXPECT_EQ(level.decision, FirstOrderDecision::LetIn);
  EXPECT_TRUE(level.was_plain);
  EXPECT_GE(level.simple_shear, found.options.momenta.plain_shear);
  EXPECT_EQ(first_iterations(found.summary, level), kLooksAfter);

  options.momenta.plain_shear = 0;
  const RegistrationResult<2> settled = register_images<2>(input, options);
  EXPECT_EQ(asked(settled.summary).decision, FirstOrderDecision::LetIn);
  EXPECT_FALSE(asked(settled.summary).was_plain);
  EXPECT_GT(first_iterations(settled.summary, asked(settled.summary)), 2 * kLooksAfter);
  EXPECT_LT(evaluations(found.summary), evaluations(settled.summary));
  EXPECT_EQ(found.displacement.samples, settled.displacement.samples);
}

// A level that was asked in vain is the same level.
TEST(PlainShear, ChangesNothingWhereItIsNotReached) {
  for (SimilarityType similarity : {SimilarityType::Ssd, SimilarityType::Lncc})
    for (PhantomKind kind : {PhantomKind::Smooth, PhantomKind::Slip}) {
      SCOPED_TRACE(to_string(similarity) + " " + to_string(kind));
      const RegistrationInput<2> input = pair_of(phantom<2>(kind, 30));
      RegistrationOptions options = default_options(Model::Auto, similarity, Preset::Balanced);
      options.momenta.plain_shear = 1e9;
      const RegistrationResult<2> asked_early = register_images<2>(input, options);
      EXPECT_FALSE(asked(asked_early.summary).was_plain);
      options.momenta.plain_shear = 0;
      const RegistrationResult<2> settled = register_images<2>(input, options);
      EXPECT_EQ(asked(asked_early.summary).simple_shear, asked(settled.summary).simple_shear);
      EXPECT_EQ(evaluations(asked_early.summary), evaluations(settled.summary));
      EXPECT_EQ(asked_early.displacement.samples, settled.displacement.samples);
    }
}

template <int Dim>
void expect_nothing_plain(SimilarityType similarity) {
  SCOPED_TRACE(to_string(similarity) + " in " + std::to_string(Dim) + "-D");
  const RegistrationResult<Dim> found = register_images<Dim>(
      pair_of(phantom<Dim>(PhantomKind::Smooth)), default_options(Model::Auto, similarity, Preset::Balanced));
  EXPECT_GT(found.options.momenta.plain_shear, 0) << "nobody looked";
  EXPECT_EQ(asked(found.summary).decision, FirstOrderDecision::LeftOut);
  for (const LevelSummary& level : found.summary.levels) {
    EXPECT_NE(level.decision, FirstOrderDecision::LetIn);
    EXPECT_FALSE(level.was_plain);
  }
}

TEST(PlainShear, IsNotSeenInSmoothMotion) {
  for (SimilarityType similarity : {SimilarityType::Mi, SimilarityType::Ngf, SimilarityType::Mind}) {
    if (similarity != SimilarityType::Mind) expect_nothing_plain<2>(similarity);  // which does not look
    expect_nothing_plain<3>(similarity);
  }
  for (SimilarityType similarity : {SimilarityType::Ssd, SimilarityType::Lncc}) expect_nothing_plain<3>(similarity);
}

// An image that turns as a whole changes as strongly everywhere as at the slip, which is seen beside that.
TEST(PlainShear, IsSeenInAnImageThatTurns) {
  for (PhantomKind kind : {PhantomKind::Slip, PhantomKind::Smooth}) {
    SCOPED_TRACE(to_string(kind));
    RegistrationInput<2> input = pair_of(phantom<2>(kind, 20));
    const ImageGrid<2> fixed = input.fixed.grid;
    const Vector<2> middle = fixed.to_world({(fixed.size[0] - 1) / 2.0, (fixed.size[1] - 1) / 2.0});
    ImageGrid<2>& turned = input.moving.grid;
    turned.direction = Eigen::Rotation2Dd(0.12).toRotationMatrix();
    turned.origin = middle + turned.direction * (fixed.origin - middle);
    const RegistrationResult<2> found =
        register_images<2>(input, default_options(Model::Auto, SimilarityType::Ncc, Preset::Balanced));
    EXPECT_EQ(asked(found.summary).decision,
              kind == PhantomKind::Slip ? FirstOrderDecision::LetIn : FirstOrderDecision::LeftOut);
    if (kind == PhantomKind::Smooth) continue;
    RegistrationOptions alone = default_options(Model::Auto, SimilarityType::Ncc, Preset::Balanced);
    alone.momenta.first_order_shear = 1e9;
    const RegistrationResult<2> hidden = register_images<2>(input, alone);
    const Lattice<2> lattice = lattice_of(fixed);
    Field<float> displacement(2 * lattice.sites());
    for (std::size_t site = 0; site < lattice.sites(); ++site)
      for (int c = 0; c < 2; ++c) displacement[2 * site + c] = hidden.displacement.component(c)[site];
    EXPECT_LT(simple_shear(lattice, displacement), found.options.momenta.first_order_shear) << "nothing is hidden";
  }
}

// Where it takes order 0 long to settle, that is given up for a few hundredths of the error: each of them a mean over
// weights that differ by a few thousandths, since the error of a single run moves by more than what is asked.
void expect_little_lost(SimilarityType similarity) {
  SCOPED_TRACE(to_string(similarity));
  Sums early, settled;
  for (double degrees : {0.0, 15.0})
    for (double weight : {0.997, 1.0, 1.003}) {
      const Phantom<2> slip = phantom<2>(PhantomKind::Slip, degrees);
      for (Sums* sums : {&early, &settled}) {
        RegistrationOptions options = default_options(Model::Auto, similarity, Preset::Balanced);
        options.similarity_parameters.weight = weight;
        if (sums == &settled) options.momenta.plain_shear = 0;
        const RegistrationResult<2> found = register_images<2>(pair_of(slip), options);
        EXPECT_EQ(asked(found.summary).was_plain, sums == &early) << degrees << " degrees";
        add<2>(found, slip, *sums);
      }
    }
  EXPECT_LT(early.error_mm, 1.05 * settled.error_mm);
  EXPECT_LT(early.error_near_mm, 1.05 * settled.error_near_mm);
  EXPECT_LT(early.evaluations, 0.9 * settled.evaluations);
}

TEST(PlainShear, SavesWhatOrderZeroIsSlowToSettleWithMi) { expect_little_lost(SimilarityType::Mi); }
TEST(PlainShear, SavesWhatOrderZeroIsSlowToSettleWithNgf) { expect_little_lost(SimilarityType::Ngf); }

// Order 0 goes on beside first orders, with another weight: next to nothing is lost by what it had not yet settled, nor
// by first weights that come from its velocity. Means as above.
TEST(PlainShear, LosesNothingInSpaceWithLncc) {
  Sums early, settled;
  for (double degrees : {0.0, 10.0, 20.0}) {
    const Phantom<3> slip = phantom<3>(PhantomKind::Slip, degrees);
    for (double weight : {0.997, 1.0, 1.003})
      for (Sums* sums : {&early, &settled}) {
        RegistrationOptions options = default_options(Model::Auto, SimilarityType::Lncc, Preset::Balanced);
        options.similarity_parameters.weight = weight;
        if (sums == &settled) options.momenta.plain_shear = options.momenta.quick_tolerance = 0;
        const RegistrationResult<3> found = register_images<3>(pair_of(slip), options);
        EXPECT_EQ(asked(found.summary).was_plain, sums == &early);
        EXPECT_DOUBLE_EQ(regularisation_beside(found.options.momenta, asked(found.summary)),
                         10 * found.options.momenta.regularisation)
            << "seen early or in the end";
        add<3>(found, slip, *sums);
      }
  }
  EXPECT_LT(early.error_mm, 1.02 * settled.error_mm);
  EXPECT_LT(early.error_near_mm, 1.02 * settled.error_near_mm);
  EXPECT_LT(early.evaluations, 0.8 * settled.evaluations);
}

enum class Shown { Early, InTheEnd, Little };

// On the level that was asked and on the finer ones, whose first orders were let in with it.
TEST(PlainShear, SaysWhatOrderZeroWeighsBesideFirstOrders) {
  const RegistrationInput<2> input = pair_of(phantom<2>(PhantomKind::Slip, 30));
  const auto found = [&](Shown shown, double times_beside_first, double times_beside_plain) {
    RegistrationOptions options = default_options(Model::Auto, SimilarityType::Lncc, Preset::Balanced);
    options.pyramid.levels = 2;
    options.momenta.first_order_scales = 2;
    options.momenta.first_order_shear = 1e-9;
    options.momenta.plain_shear = shown == Shown::Early ? 1e-9 : 1e9;
    options.momenta.settled_plain_shear = shown == Shown::InTheEnd ? 1e-9 : shown == Shown::Little ? 1e9 : 0;
    options.momenta.regularisation_beside_first = times_beside_first * options.momenta.regularisation;
    options.momenta.regularisation_beside_plain = times_beside_plain * options.momenta.regularisation;
    const RegistrationResult<2> result = register_images<2>(input, options);
    const LevelSummary &coarse = result.summary.levels.front(), &fine = result.summary.levels.back();
    EXPECT_EQ(coarse.decision, FirstOrderDecision::LetIn);
    EXPECT_EQ(coarse.was_plain, shown == Shown::Early);
    EXPECT_EQ(fine.decision, FirstOrderDecision::None) << "it was decided before";
    return result.displacement.samples;
  };
  for (Shown shown : {Shown::Early, Shown::InTheEnd, Shown::Little}) {
    SCOPED_TRACE(static_cast<int>(shown));
    const auto held_less = found(shown, 2, 0), held_more = found(shown, 8, 0);
    EXPECT_NE(held_less, held_more);
    EXPECT_EQ(found(shown, 2, 8), shown == Shown::Little ? held_less : held_more);
  }
}

// Where an interface bends, a slip shows less, and not early.
TEST(PlainShear, IsNotShownByASlipAroundASmallBody) {
  const std::map<SimilarityType, double> times = {
      {SimilarityType::Lncc, 5}, {SimilarityType::Ngf, 1}, {SimilarityType::Mind, 0.5}};
  for (const auto& [similarity, slip_mm] : {std::pair(SimilarityType::Lncc, 4), std::pair(SimilarityType::Ngf, 4),
                                            std::pair(SimilarityType::Mind, 4), std::pair(SimilarityType::Lncc, 8)}) {
    SCOPED_TRACE(to_string(similarity) + " " + std::to_string(slip_mm));
    const Phantom<3> body = body_that_slides(14, slip_mm);
    RegistrationOptions options = default_options(Model::Auto, similarity, Preset::Balanced);
    Sums let_in, left_out;
    for (Sums* sums : {&let_in, &left_out}) {
      if (sums == &left_out) options.momenta.first_order_shear = 1e9;
      const RegistrationResult<3> found = register_images<3>(pair_of(body), options);
      const LevelSummary& level = asked(found.summary);
      EXPECT_EQ(level.decision, sums == &let_in ? FirstOrderDecision::LetIn : FirstOrderDecision::LeftOut);
      EXPECT_FALSE(level.was_plain);
      EXPECT_GT(found.options.momenta.plain_shear, 0);
      EXPECT_LT(level.simple_shear, 12) << "what other presets ask is too much";
      EXPECT_DOUBLE_EQ(regularisation_beside(found.options.momenta, level),
                       times.at(similarity) * found.options.momenta.regularisation);
      add<3>(found, body, *sums);
    }
    EXPECT_LT(let_in.error_mm, 0.8 * left_out.error_mm);
    EXPECT_LT(let_in.error_near_mm, 0.8 * left_out.error_near_mm);
  }
}

/// No first order wants to be there: order 0 goes on until it has settled, and all that each look was is an evaluation.
void expect_a_look_in_vain(RegistrationOptions options) {
  const RegistrationInput<2> input = pair_of(phantom<2>(PhantomKind::Slip));
  options.momenta.sparsity = 1e6;
  options.momenta.first_order_shear = options.momenta.plain_shear = 1e-9;
  const RegistrationResult<2> found = register_images<2>(input, options);
  EXPECT_EQ(asked(found.summary).decision, FirstOrderDecision::LeftOut);
  EXPECT_FALSE(asked(found.summary).was_plain);
  options.momenta.plain_shear = 0;
  const RegistrationResult<2> settled = register_images<2>(input, options);
  EXPECT_EQ(asked(found.summary).evaluations, asked(settled.summary).evaluations + 1);
  EXPECT_EQ(found.displacement.samples, settled.displacement.samples);
  // The same of the look when it has settled to `tolerance`, which is none where that is what it goes on to.
  options.optimisation.look_tolerance = options.optimisation.tolerance / 8;
  options.optimisation.noise_tolerance = 0;
  const RegistrationResult<2> twice = register_images<2>(input, options);
  options.optimisation.tolerance = options.optimisation.look_tolerance;
  const RegistrationResult<2> once = register_images<2>(input, options);
  EXPECT_EQ(asked(twice.summary).decision, FirstOrderDecision::LeftOut);
  EXPECT_EQ(asked(twice.summary).evaluations, asked(once.summary).evaluations + 1);
  EXPECT_EQ(twice.displacement.samples, once.displacement.samples);
  // One that is quick has settled as well where that is the same, and is asked once.
  if (!options.momenta.first_order_waits) return;
  for (double tolerance : {0.3, 0.5}) {
    options.optimisation.tolerance = tolerance;
    options.momenta.quick_tolerance = 0;
    const RegistrationResult<2> settles = register_images<2>(input, options);
    options.momenta.quick_tolerance = tolerance;
    const RegistrationResult<2> is_quick = register_images<2>(input, options);
    EXPECT_EQ(asked(is_quick.summary).evaluations, asked(settles.summary).evaluations);
    EXPECT_EQ(is_quick.displacement.samples, settles.displacement.samples);
    options.momenta.quick_tolerance = 0.875;
    const RegistrationResult<2> both = register_images<2>(input, options);
    EXPECT_EQ(asked(both.summary).evaluations, asked(settles.summary).evaluations + 1);
    EXPECT_EQ(both.displacement.samples, settles.displacement.samples);
  }
}

TEST(PlainShear, IsNotEnoughWhereNoneWouldJoin) {
  RegistrationOptions options = default_options(Model::Auto, SimilarityType::Lncc, Preset::Balanced);
  options.momenta.orientations = 0;
  expect_a_look_in_vain(options);
}

// Where momenta of both orders lie on one lattice, blocks could join: not while order 0 goes on alone.
TEST(PlainShear, LetsNobodyJoinAfterALookInVain) {
  RegistrationOptions options = default_options(Model::Wendland1, SimilarityType::Lncc, Preset::Balanced);
  options.pyramid.levels = 1;
  options.momenta.first_order_waits = true;
  expect_a_look_in_vain(options);
}

// Also where it is asked whether any would join, which is an evaluation.
TEST(PlainShear, StopsInTheLook) {
  const RegistrationInput<2> input = pair_of(phantom<2>(PhantomKind::Slip));
  RegistrationOptions options = default_options(Model::Auto, SimilarityType::Lncc, Preset::Balanced);
  options.pyramid.levels = 1;
  options.momenta.orientations = 0;
  options.momenta.first_order_shear = 1e-9;
  options.optimisation.tolerance = 0.05;
  const RegistrationResult<2> settled = register_images<2>(input, options);
  const int settles_after = first_iterations(settled.summary, asked(settled.summary));
  ASSERT_GT(settles_after, kLooksAfter);
  for (const auto& [plain_shear, after] : {std::pair(1e-9, kLooksAfter), std::pair(0.0, settles_after)})
    for (double sparsity : {1e-3, 1e6})
      for (int call = 1; call <= 8; ++call) {
        SCOPED_TRACE(std::to_string(after) + ' ' + std::to_string(sparsity) + ' ' + std::to_string(call));
        options.momenta.plain_shear = plain_shear;
        options.momenta.sparsity = sparsity;
        int calls = 0, calls_after = 0;
        bool is_told = false;
        const RegistrationResult<2> found = register_images<2>(input, options, [&](const Progress& at) {
          calls_after += is_told;
          is_told = is_told || (at.iteration == after && ++calls == call);
          return is_told ? ProgressAnswer::Stop : ProgressAnswer::Continue;
        });
        EXPECT_TRUE(is_told);
        EXPECT_EQ(found.summary.termination, Termination::Stopped);
        EXPECT_EQ(calls_after, 0);
        const LevelSummary& level = found.summary.levels.back();
        EXPECT_EQ(level.iterations, after);
        EXPECT_TRUE(level.simple_shear == 0 || level.decision == FirstOrderDecision::LetIn) << "nothing rests on it";
      }
}

// The velocity at time 0 shows too little of it.
TEST(PlainShear, IsSeenAroundASmallBodyThatTurns) {
  PhantomOptions scene = default_phantom_options(PhantomKind::Slip);
  scene.size = {256, 256, 1};
  scene.noise = 0.01;
  scene.interface = InterfaceShape::Circle;
  scene.radius_mm = 16;
  scene.slip_mm = 6;
  for (std::uint64_t seed : {2, 3}) {
    SCOPED_TRACE(seed);
    scene.seed = seed;
    const Phantom<2> body = make_phantom<2>(scene);
    RegistrationOptions options = default_options(Model::Auto, SimilarityType::Lncc, Preset::Balanced);
    Sums let_in, left_out;
    for (Sums* sums : {&let_in, &left_out}) {
      if (sums == &left_out) options.momenta.first_order_shear = 1e9;
      const RegistrationResult<2> found = register_images<2>(pair_of(body), options);
      EXPECT_EQ(asked(found.summary).decision,
                sums == &let_in ? FirstOrderDecision::LetIn : FirstOrderDecision::LeftOut);
      add<2>(found, body, *sums);
    }
    EXPECT_LT(let_in.error_mm, 0.9 * left_out.error_mm);
    EXPECT_LT(let_in.error_near_mm, 0.6 * left_out.error_near_mm);
  }
}

// What was seen then and was too little is not told of a level that has not been decided.
TEST(PlainShear, IsForgottenWhereItWasLittle) {
  const RegistrationInput<2> input = pair_of(phantom<2>(PhantomKind::Slip));
  RegistrationOptions options = default_options(Model::Auto, SimilarityType::Lncc, Preset::Balanced);
  options.pyramid.levels = 1;
  options.momenta.plain_shear = 1e9;
  const RegistrationResult<2> found = register_images<2>(input, options, [&](const Progress& at) {
    return at.iteration > kLooksAfter ? ProgressAnswer::Stop : ProgressAnswer::Continue;
  });
  EXPECT_EQ(found.summary.termination, Termination::Stopped);
  EXPECT_EQ(found.summary.levels.back().decision, FirstOrderDecision::None);
  EXPECT_EQ(found.summary.levels.back().simple_shear, 0);
}

// Whoever says stop while a slip is looked for is not asked again.
TEST(PlainShear, StopsWhereItIsTold) {
  const RegistrationInput<2> input = pair_of(phantom<2>(PhantomKind::Slip, 30));
  RegistrationOptions options = default_options(Model::Auto, SimilarityType::Ssd, Preset::Balanced);
  options.pyramid.levels = 1;
  for (int iteration = 1; iteration <= kLooksAfter; ++iteration) {
    bool is_told = false;
    int calls_after = 0;
    const RegistrationResult<2> found = register_images<2>(input, options, [&](const Progress& at) {
      calls_after += is_told;
      is_told = is_told || at.iteration >= iteration;
      return is_told ? ProgressAnswer::Stop : ProgressAnswer::Continue;
    });
    EXPECT_EQ(found.summary.termination, Termination::Stopped) << iteration;
    EXPECT_EQ(calls_after, 0) << iteration;
    EXPECT_EQ(found.summary.levels.back().decision, FirstOrderDecision::None) << iteration;
  }
}

TEST(PlainShear, IsWhatWasMeasured) {
  const Lattice<2> plane{{128, 128}, {1, 1}, {}};
  const Lattice<3> cube{{128, 128, 128}, {1, 1, 1}, {}};
  const auto momenta = [](Model model, SimilarityType similarity, Preset preset, const auto& image) {
    return resolved(default_options(model, similarity, preset), image).momenta;
  };
  const auto share = [&](SimilarityType similarity, Preset preset, const auto& image) {
    const RegistrationOptions::Momenta found = momenta(Model::Auto, similarity, preset, image);
    return found.plain_shear / found.first_order_shear;
  };
  for (Preset preset : {Preset::Fast, Preset::Balanced, Preset::Accurate}) {
    EXPECT_EQ(share(SimilarityType::Ssd, preset, plane), 2);
    EXPECT_EQ(share(SimilarityType::Ssd, preset, cube), 2);
    EXPECT_EQ(share(SimilarityType::Lncc, preset, plane), 0);
    EXPECT_EQ(momenta(Model::Auto, SimilarityType::Lncc, preset, cube).plain_shear, preset == Preset::Fast ? 0 : 24);
    EXPECT_EQ(share(SimilarityType::Ncc, preset, plane), 0);
    EXPECT_EQ(share(SimilarityType::Ncc, preset, cube), 0);
    for (SimilarityType similarity : {SimilarityType::Mi, SimilarityType::Ngf, SimilarityType::Mind}) {
      // With mind in 2-D more than a few hundredths of the error would be given up.
      const bool asks = preset == Preset::Balanced && similarity != SimilarityType::Mind;
      EXPECT_DOUBLE_EQ(share(similarity, preset, plane), asks ? 1.6 : 0);
      const double asked = momenta(Model::Auto, similarity, preset, cube).plain_shear;
      EXPECT_DOUBLE_EQ(asked, preset != Preset::Balanced ? 0 : similarity == SimilarityType::Mi ? 8 : 24);
      EXPECT_EQ(momenta(Model::Sliding, similarity, preset, plane).plain_shear, 0);
    }
    EXPECT_EQ(momenta(Model::Sliding, SimilarityType::Ssd, preset, plane).plain_shear, 0);
  }
  for (SimilarityType similarity : all_similarities())
    for (Preset preset : all_presets()) {
      const auto settled = momenta(Model::Auto, similarity, preset, cube).settled_plain_shear;
      const bool is_smaller = similarity == SimilarityType::Ngf || similarity == SimilarityType::Mind;
      EXPECT_EQ(settled, preset == Preset::Fast ? 0 : similarity == SimilarityType::Lncc ? 20 : is_smaller ? 12 : 0);
      EXPECT_EQ(momenta(Model::Auto, similarity, preset, plane).settled_plain_shear, 0);
      EXPECT_EQ(momenta(Model::Sliding, similarity, preset, cube).settled_plain_shear, 0);
    }
  for (SimilarityType similarity : all_similarities())
    for (Preset preset : all_presets()) {
      EXPECT_EQ(momenta(Model::Auto, similarity, preset, cube).quick_share,
                preset != Preset::Balanced || similarity == SimilarityType::Ssd ? 0
                : similarity == SimilarityType::Mi                              ? 0.7
                                                                                : 0.79);
      EXPECT_EQ(momenta(Model::Auto, similarity, preset, plane).quick_share, 0);
      EXPECT_EQ(momenta(Model::Sliding, similarity, preset, cube).quick_share, 0);
      EXPECT_EQ(momenta(Model::Auto, similarity, preset, cube).quick_tolerance,
                preset != Preset::Balanced || similarity == SimilarityType::Ssd ? 0 : 0.22);
      EXPECT_EQ(momenta(Model::Auto, similarity, preset, plane).quick_tolerance, 0);
      EXPECT_EQ(momenta(Model::Sliding, similarity, preset, cube).quick_tolerance, 0);
    }
  // It was measured beside elements alone.
  for (const auto& [orientations, alone] : {std::pair(0, 0), std::pair(9, 0), std::pair(9, 1)}) {
    RegistrationOptions others = default_options(Model::Auto, SimilarityType::Ncc, Preset::Balanced);
    others.momenta.orientations = orientations;
    others.momenta.oriented_alone = alone;
    EXPECT_EQ(resolved(others, cube).momenta.quick_share, 0) << orientations << ' ' << alone;
    EXPECT_EQ(resolved(others, cube).momenta.quick_tolerance, 0) << orientations << ' ' << alone;
  }
  RegistrationOptions soon = default_options(Model::Auto, SimilarityType::Ncc, Preset::Balanced);
  soon.optimisation.tolerance = 0.3;
  EXPECT_EQ(resolved(soon, cube).momenta.quick_tolerance, 0.3);
  soon.momenta.first_order_shear = 0;
  EXPECT_EQ(resolved(soon, cube).momenta.quick_tolerance, 0);
  // One weight for all slips: as much is asked of all.
  RegistrationOptions stiff = default_options(Model::Auto, SimilarityType::Lncc, Preset::Balanced);
  stiff.momenta.regularisation_beside_first = 12 * stiff.momenta.regularisation;
  const RegistrationOptions::Momenta of_all = resolved(stiff, cube).momenta;
  EXPECT_EQ(of_all.first_order_shear, 12);
  EXPECT_EQ(of_all.plain_shear, 24);
  EXPECT_EQ(of_all.settled_plain_shear, 0);
  for (SimilarityType similarity : {SimilarityType::Ngf, SimilarityType::Mind}) {
    stiff = default_options(Model::Auto, similarity, Preset::Balanced);
    stiff.momenta.regularisation_beside_first = 2 * stiff.momenta.regularisation;
    EXPECT_EQ(resolved(stiff, cube).momenta.first_order_shear, 10);
    EXPECT_DOUBLE_EQ(resolved(stiff, cube).momenta.plain_shear, 16);
  }
  RegistrationOptions sliding = default_options(Model::Sliding, SimilarityType::Lncc, Preset::Balanced);
  sliding.momenta.first_order_shear = sliding.momenta.settled_plain_shear = -1;
  EXPECT_EQ(resolved(sliding, cube).momenta.first_order_shear, 12);
  EXPECT_EQ(resolved(sliding, cube).momenta.settled_plain_shear, 0);
  sliding.momenta.quick_share = sliding.momenta.quick_tolerance = -1;
  EXPECT_EQ(resolved(sliding, cube).momenta.quick_share, 0);
  EXPECT_EQ(resolved(sliding, cube).momenta.quick_tolerance, 0);
  RegistrationOptions less = default_options(Model::Auto, SimilarityType::Lncc, Preset::Balanced);
  less.momenta.first_order_shear = 2;  // a plain slip stays what it is
  EXPECT_EQ(resolved(less, cube).momenta.plain_shear, 24);
  less.momenta.first_order_shear = 20;
  EXPECT_EQ(resolved(less, cube).momenta.plain_shear, 24);
  less.momenta.first_order_shear = 30;
  EXPECT_EQ(resolved(less, cube).momenta.plain_shear, 30);
  RegistrationOptions alike = default_options(Model::Auto, SimilarityType::Lncc, Preset::Balanced);
  alike.momenta.regularisation_beside_first = alike.momenta.regularisation;  // order 0 goes on as it was
  EXPECT_EQ(resolved(alike, cube).momenta.plain_shear, 0);
  alike.momenta.regularisation_beside_first = 0;
  alike.momenta.regularisation_beside_plain = alike.momenta.regularisation;
  EXPECT_EQ(resolved(alike, cube).momenta.plain_shear, 0);
  EXPECT_EQ(resolved(alike, cube).momenta.settled_plain_shear, 20);
  RegistrationOptions beside = default_options(Model::Auto, SimilarityType::Mi, Preset::Balanced);
  beside.momenta.first_order_waits = false;  // nobody has to wait, so nothing is given up
  EXPECT_EQ(resolved(beside, plane).momenta.plain_shear, 2 * resolved(beside, plane).momenta.first_order_shear);
  beside = default_options(Model::Auto, SimilarityType::Ngf, Preset::Balanced);
  beside.momenta.first_order_waits = false;
  EXPECT_EQ(resolved(beside, cube).momenta.plain_shear, 24);
  RegistrationOptions given = default_options(Model::Auto, SimilarityType::Ssd, Preset::Balanced);
  given.momenta.first_order_shear = std::numeric_limits<double>::max();
  EXPECT_TRUE(problems(resolved(given, plane)).empty());
  given.momenta.first_order_shear = -1;
  given.momenta.plain_shear = 7;
  EXPECT_EQ(resolved(given, plane).momenta.plain_shear, 7);
  EXPECT_EQ(resolved(resolved(given, plane), plane).momenta.plain_shear, 7);
}

TEST(PlainShear, IsRefusedWhereItCannotBeMeant) {
  using ::testing::ElementsAre;
  using ::testing::HasSubstr;
  RegistrationOptions options = default_options(Model::Sliding, SimilarityType::Ssd, Preset::Balanced);
  options.momenta.plain_shear = 12;
  EXPECT_THAT(problems(options), ElementsAre(HasSubstr("plain_shear is 12 and first_order_shear is 0")));
  options.momenta.first_order_shear = 12;
  EXPECT_TRUE(problems(options).empty());
  for (const auto& [name, quick] : {std::pair("quick_share", &RegistrationOptions::Momenta::quick_share),
                                    std::pair("quick_tolerance", &RegistrationOptions::Momenta::quick_tolerance)}) {
    const std::string is_half = std::string(name) + " is 0.5 and ";
    options.momenta.*quick = 0.5;
    options.momenta.first_order_shear = 12;
    options.momenta.first_order_waits = false;
    EXPECT_THAT(problems(options), ElementsAre(HasSubstr(is_half + "first_order_waits is false")));
    options.momenta.first_order_waits = true;
    EXPECT_TRUE(problems(options).empty());
    options.momenta.plain_shear = options.momenta.first_order_shear = 0;
    EXPECT_THAT(problems(options), ElementsAre(HasSubstr(is_half + "first_order_shear is 0")));
    options.momenta.*quick = 0;
  }
  options.momenta.first_order_shear = 12;
  options.momenta.quick_tolerance = 0.5;
  options.optimisation.tolerance = 0.625;
  EXPECT_THAT(problems(options), ElementsAre(HasSubstr("quick_tolerance is 0.5 and tolerance is 0.625")));
  options.optimisation.tolerance = 0.5;
  EXPECT_TRUE(problems(options).empty());
  // Where it turns out that order 0 is not asked, it is of no use, and no mistake.
  options = default_options(Model::Auto, SimilarityType::Ssd, Preset::Balanced);
  options.momenta.plain_shear = 12;
  options.momenta.sparsity = 0;
  const RegistrationOptions found = resolved(options, Lattice<2>{{64, 64}, {1, 1}, {}});
  EXPECT_EQ(found.momenta.plain_shear, 0);
  EXPECT_TRUE(problems(found).empty());
}

}  // namespace
}  // namespace saltus
