#include "core/registration/scales.h"
#include "core/registration/narrower_scale.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/grid/noise.h"
#include "core/registration/options.h"

#include <cmath>
#include <utility>

namespace saltus {
namespace {

Lattice<2> plane(double mm) { return {{128, 128}, {mm, mm}, {}}; }
Lattice<3> block(double mm) { return {{128, 128, 96}, {mm, mm, 2 * mm}, {}}; }

RegistrationOptions automatic(SimilarityType similarity, Preset preset = Preset::Balanced) {
  return default_options(Model::Auto, similarity, preset);
}

// core/measurements.md, "Widths": a Gaussian of six pixels holds far fewer samples than of six voxels. Only `ssd`,
// which has no window, gains by it.
TEST(ResolvedOptions, BeginAGaussianAtTwoPixelsInPlanes) {
  EXPECT_EQ(resolved(automatic(SimilarityType::Lncc), plane(1)).momenta.finest_scale, 1);
  EXPECT_EQ(resolved(automatic(SimilarityType::Ncc), plane(1)).momenta.finest_scale, 1);
  EXPECT_EQ(
      resolved(default_options(Model::Gaussian, SimilarityType::Ssd, Preset::Balanced), plane(1)).momenta.finest_scale,
      0);
  RegistrationOptions asked = automatic(SimilarityType::Lncc);
  asked.momenta.finest_scale = 0;
  EXPECT_EQ(resolved(asked, plane(1)).momenta.finest_scale, 0);
  EXPECT_EQ(resolved(default_options(Model::Wendland1, SimilarityType::Lncc, Preset::Balanced), plane(1))
                .momenta.finest_scale,
            0);
}

// core/measurements.md, "Memory".
TEST(ResolvedOptions, HaveNoFirstOrdersAtAllVoxelsOfAVolume) {
  const auto finest = [](RegistrationOptions options, double mm) {
    const RegistrationOptions::Momenta of = resolved(options, block(mm)).momenta;
    return std::pair(of.finest_scale, of.first_order_finest_scale);
  };
  for (const Preset preset : {Preset::Balanced, Preset::Accurate})
    for (const double mm : {1.0, 2.5}) {
      SCOPED_TRACE(mm);
      RegistrationOptions options = default_options(Model::Wendland1, SimilarityType::Ncc, preset);
      EXPECT_EQ(finest(options, mm), std::pair(1, 1));
      options.momenta.finest_scale = options.momenta.first_order_finest_scale = 0;
      EXPECT_EQ(finest(options, mm), std::pair(0, 0));
      options.momenta.finest_scale = options.momenta.first_order_finest_scale = -1;
      options.pyramid.levels = 1;  // there is no coarser lattice
      EXPECT_EQ(finest(options, mm), std::pair(0, 0));
    }
  // Those of blocks may be as fine as the images.
  EXPECT_EQ(finest(default_options(Model::Sliding, SimilarityType::Ncc, Preset::Balanced), 2.5), std::pair(0, 0));
}

TEST(ResolvedOptions, LetAccurateSeeFinerImagesWithTheSameKernels) {
  for (const double mm : {1.0, 1.5, 1.6, 2.5}) {
    SCOPED_TRACE(mm);
    const RegistrationOptions balanced = resolved(automatic(SimilarityType::Lncc), block(mm)),
                              accurate = resolved(automatic(SimilarityType::Lncc, Preset::Accurate), block(mm));
    EXPECT_EQ(balanced.pyramid.finest_level, mm <= 1.5 ? 1 : 0);
    EXPECT_EQ(balanced.momenta.finest_scale, balanced.pyramid.finest_level);
    EXPECT_EQ(accurate.pyramid.finest_level, 0);
    EXPECT_EQ(accurate.momenta.finest_scale, balanced.momenta.finest_scale);
    EXPECT_EQ(accurate.momenta.first_order_finest_scale, balanced.momenta.first_order_finest_scale);
    EXPECT_EQ(flow_lattice_beside_first(block(mm), accurate, 0), level_lattice(block(mm), mm <= 1.5 ? 1 : 0));
    // What else has first orders has them as fine as the images.
    for (const RegistrationOptions& other : {automatic(SimilarityType::Ssd, Preset::Accurate),
                                             default_options(Model::Sliding, SimilarityType::Lncc, Preset::Accurate)})
      EXPECT_EQ(resolved(other, block(mm)).momenta.first_order_finest_scale, 0);
  }
  RegistrationOptions asked = automatic(SimilarityType::Lncc, Preset::Accurate);
  asked.momenta.first_order_finest_scale = 0;
  EXPECT_EQ(resolved(asked, block(1)).momenta.first_order_finest_scale, 0);
  asked = automatic(SimilarityType::Lncc, Preset::Accurate);
  asked.pyramid.finest_level = 0;  // by the caller: kernels go along
  EXPECT_EQ(resolved(asked, block(1)).momenta.finest_scale, 0);
  EXPECT_EQ(resolved(asked, block(1)).momenta.first_order_finest_scale, 0);
}

TEST(ResolvedOptions, HaveTheFlowWhereFirstOrdersAre) {
  RegistrationOptions options = default_options(Model::Sliding, SimilarityType::Lncc, Preset::Balanced);
  struct Placed {
    int first, coarsening, level, flow;
  };
  for (const auto& [first, coarsening, level, flow] :
       {Placed{0, 1, 0, 0}, {1, 1, 0, 1}, {1, 1, 1, 1}, {2, 1, 0, 1}, {2, 2, 0, 2}, {1, 0, 0, 0}, {0, 1, 1, 1}}) {
    options.momenta.first_order_finest_scale = first;
    options.flow.coarsening = coarsening;
    EXPECT_EQ(flow_lattice_beside_first(block(1), options, level), level_lattice(block(1), flow))
        << first << ", " << coarsening << ", " << level;
  }
}

// core/measurements.md, "Finer images".
TEST(ResolvedOptions, EndRoundsEarlyWhereThatWasMeasured) {
  const auto of = [](SimilarityType similarity, Preset preset, const auto& image) {
    return resolved(automatic(similarity, preset), image).optimisation.round_tolerance;
  };
  for (SimilarityType similarity : {SimilarityType::Ncc, SimilarityType::Mi}) {
    SCOPED_TRACE(to_string(similarity));
    const double in_space = similarity == SimilarityType::Ncc ? 0.1 : 0.5;
    EXPECT_EQ(of(similarity, Preset::Balanced, plane(1)), 0.1);
    EXPECT_EQ(of(similarity, Preset::Accurate, plane(1)), 0);
    EXPECT_EQ(of(similarity, Preset::Balanced, block(1)), in_space);
    EXPECT_EQ(of(similarity, Preset::Accurate, block(1)), in_space);
    EXPECT_EQ(of(similarity, Preset::Fast, block(1)), 0);
  }
}

TEST(ResolvedOptions, LoseLessOfTheNoiseWhereAccurateSeesFinerImages) {
  const auto lost = [](SimilarityType similarity, Preset preset, const auto& image) {
    return resolved(automatic(similarity, preset), image).similarity_parameters.lost_noise;
  };
  for (SimilarityType similarity : all_similarities()) {
    SCOPED_TRACE(to_string(similarity));
    const bool is_one = similarity == SimilarityType::Lncc || similarity == SimilarityType::Ngf;
    EXPECT_EQ(lost(similarity, Preset::Accurate, block(1.5)), is_one ? 0.003 : 0.0075);
    EXPECT_EQ(lost(similarity, Preset::Accurate, block(1.6)), 0.0075);
    EXPECT_EQ(lost(similarity, Preset::Accurate, plane(1)), 0.0075);
    EXPECT_EQ(lost(similarity, Preset::Balanced, block(1.5)), 0.0075);
  }
  for (Model model : {Model::Gaussian, Model::Wendland, Model::Sliding}) {  // as they were
    RegistrationOptions other = default_options(model, SimilarityType::Lncc, Preset::Accurate);
    EXPECT_EQ(resolved(other, block(1)).similarity_parameters.lost_noise, 0.0075);
    other.similarity_parameters.lost_noise = 0;
    EXPECT_EQ(resolved(other, block(1)).similarity_parameters.lost_noise, 0.0075);
  }
  RegistrationOptions asked = automatic(SimilarityType::Lncc, Preset::Accurate);
  asked.similarity_parameters.lost_noise = 0.02;
  EXPECT_EQ(resolved(asked, block(1)).similarity_parameters.lost_noise, 0.02);
}

TEST(ResolvedOptions, HoldFirstOrdersBackAsWasMeasured) {
  const auto sparsity = [](const RegistrationOptions& options, const auto& image) {
    return resolved(options, image).momenta.sparsity;
  };
  EXPECT_EQ(sparsity(automatic(SimilarityType::Lncc), plane(1)), 0.1);
  EXPECT_EQ(sparsity(automatic(SimilarityType::Lncc), block(2)), 0.025);
  EXPECT_EQ(sparsity(automatic(SimilarityType::Lncc, Preset::Fast), plane(1)), 0.2);
  EXPECT_EQ(sparsity(automatic(SimilarityType::Lncc, Preset::Fast), block(2)), 0.2);
  RegistrationOptions asked = automatic(SimilarityType::Lncc);
  asked.momenta.sparsity = 0.07;
  EXPECT_EQ(sparsity(asked, plane(1)), 0.07);
  const auto of_sliding = [&](Preset preset) {
    return sparsity(default_options(Model::Sliding, SimilarityType::Ncc, preset), plane(1));
  };
  EXPECT_EQ(sparsity(automatic(SimilarityType::Ncc), plane(1)), 2 * of_sliding(Preset::Balanced));
  EXPECT_EQ(sparsity(automatic(SimilarityType::Ncc, Preset::Fast), plane(1)), of_sliding(Preset::Fast));
  struct Held {  // so many times as with sliding
    SimilarityType similarity;
    double flat, deep;
  };
  for (const auto& [similarity, flat, deep] :
       {Held{SimilarityType::Mi, 2, 5}, Held{SimilarityType::Ngf, 2, 2}, Held{SimilarityType::Mind, 3, 1.5}})
    for (Preset preset : all_presets()) {
      SCOPED_TRACE(to_string(similarity) + " " + to_string(preset));
      const bool is_balanced = preset == Preset::Balanced;
      const double usual = sparsity(default_options(Model::Sliding, similarity, preset), plane(1));
      EXPECT_DOUBLE_EQ(sparsity(automatic(similarity, preset), plane(1)), is_balanced ? flat * usual : usual);
      EXPECT_DOUBLE_EQ(sparsity(automatic(similarity, preset), block(2)),
                       preset != Preset::Fast ? deep * usual : usual);
    }
  for (SimilarityType similarity : all_similarities()) {
    RegistrationOptions sliding = default_options(Model::Sliding, similarity, Preset::Balanced);
    const double usual = sparsity(sliding, plane(1));
    EXPECT_GT(usual, 0);
    sliding.momenta.sparsity = -1;
    EXPECT_TRUE(problems(sliding).empty());
    EXPECT_EQ(sparsity(sliding, plane(1)), usual);
    sliding.momenta.sparsity = -0.5;
    EXPECT_THAT(problems(sliding), ::testing::ElementsAre(::testing::HasSubstr("parameter sparsity is -0.5")));
  }
}

TEST(ResolvedOptions, AskOfFirstOrdersWhatWasMeasured) {
  const auto asked_of = [](SimilarityType similarity, const auto& image) {
    return resolved(automatic(similarity), image).momenta.first_order_shear;
  };
  EXPECT_EQ(asked_of(SimilarityType::Ssd, plane(1)), 6);
  EXPECT_EQ(asked_of(SimilarityType::Lncc, plane(1)), 6);
  EXPECT_EQ(asked_of(SimilarityType::Ncc, block(2)), 5);
  EXPECT_EQ(asked_of(SimilarityType::Ssd, block(2)), 5);
  EXPECT_EQ(asked_of(SimilarityType::Lncc, block(2)), 5);
  EXPECT_EQ(resolved(automatic(SimilarityType::Lncc, Preset::Accurate), block(2)).momenta.first_order_shear, 5);
  EXPECT_EQ(resolved(automatic(SimilarityType::Lncc, Preset::Fast), block(2)).momenta.first_order_shear, 12)
      << "in which plain slips and others are not told apart";
  EXPECT_EQ(asked_of(SimilarityType::Mi, plane(1)), 6);
  EXPECT_EQ(asked_of(SimilarityType::Mi, block(2)), 5);
  for (SimilarityType similarity : {SimilarityType::Ngf, SimilarityType::Mind}) {
    EXPECT_EQ(asked_of(similarity, plane(1)), 6);
    EXPECT_EQ(asked_of(similarity, block(2)), 5);
    EXPECT_EQ(resolved(automatic(similarity, Preset::Accurate), block(2)).momenta.first_order_shear, 5);
    EXPECT_EQ(resolved(automatic(similarity, Preset::Fast), block(2)).momenta.first_order_shear, 5)
        << "order 0 that has not settled shows less";
  }
  RegistrationOptions asked = automatic(SimilarityType::Ssd);
  asked.momenta.first_order_shear = 0.25;
  EXPECT_EQ(resolved(asked, plane(1)).momenta.first_order_shear, 0.25);
}

TEST(MakeScales, WeighCoarserOrderZeroByAShareOfTheNextFiner) {
  RegistrationOptions asked = default_options(Model::Gaussian, SimilarityType::Ssd, Preset::Balanced);
  asked.momenta.regularisation = 2e-3;
  for (double share : {1.0, 0.25}) {
    asked.momenta.coarser_regularisation = share;
    const RegistrationOptions used = resolved(asked, plane(1));
    const auto scales = make_scales<2, float>(plane(1), used);
    ASSERT_GT(scales.size(), 2u);
    for (const auto& placed : scales)
      EXPECT_NEAR(placed.scale->options().zeroth_weight,
                  500 / std::pow(share, placed.level - used.momenta.finest_scale), 1e-6)
          << placed.level;
  }
  EXPECT_TRUE(problems(asked).empty());
  for (double wrong : {0.0, -0.25, 1.5}) {
    asked.momenta.coarser_regularisation = wrong;
    EXPECT_THAT(problems(asked), ::testing::ElementsAre(::testing::HasSubstr("coarser_regularisation is ")));
  }
}

TEST(ResolvedOptions, GiveOrder0ThatStaysAloneFinerScalesWhereThatWasMeasured) {
  const auto asked_of = [](const RegistrationOptions& asked, const auto& image) {
    return resolved(asked, image).momenta.finer_shear;
  };
  RegistrationOptions asked = automatic(SimilarityType::Ssd);
  EXPECT_EQ(asked_of(asked, block(1)), resolved(asked, block(1)).momenta.first_order_shear);
  EXPECT_EQ(asked_of(asked, plane(1)), 0);
  EXPECT_EQ(asked_of(automatic(SimilarityType::Ncc), block(1)), 0);
  EXPECT_EQ(asked_of(default_options(Model::Sliding, SimilarityType::Ssd, Preset::Balanced), block(1)), 0);
  // What accurate takes at full resolution it takes to see more, unless somebody wants it there.
  RegistrationOptions accurate = automatic(SimilarityType::Ssd, Preset::Accurate);
  EXPECT_EQ(asked_of(accurate, block(1)), 0);
  EXPECT_GT(asked_of(accurate, block(2)), 0);
  accurate.pyramid.finest_level = 0;
  EXPECT_GT(asked_of(accurate, block(1)), 0);
  RegistrationOptions given = asked;
  given.momenta.first_order_shear = 1e9;
  EXPECT_EQ(asked_of(given, block(1)), 1e9);
  given.momenta.finest_scale = 2;
  EXPECT_EQ(asked_of(given, block(1)), 0);
  given = asked;
  given.momenta.first_order_waits = true;
  EXPECT_EQ(asked_of(given, block(1)), 0);
  given.momenta.finer_shear = 3;
  EXPECT_THAT(problems(given), ::testing::ElementsAre(::testing::HasSubstr("finer_shear is 3 and first_order_waits")));
  asked.momenta.finer_shear = 0.25;
  EXPECT_EQ(asked_of(asked, plane(1)), 0.25);
  asked.momenta.first_order_shear = 0;
  EXPECT_EQ(asked_of(asked, plane(1)), 0) << "nothing is asked of order 0";
}

TEST(ResolvedOptions, GiveLnccWiderWindowsInThePlane) {
  RegistrationOptions asked = automatic(SimilarityType::Lncc);
  EXPECT_EQ(resolved(asked, plane(1)).similarity_parameters.lncc_radius_voxels, 4);
  EXPECT_EQ(resolved(asked, block(1)).similarity_parameters.lncc_radius_voxels, 2);
  EXPECT_EQ(resolved(asked, plane(1)).similarity_parameters.lncc_cell, 2);
  EXPECT_EQ(resolved(asked, block(1)).similarity_parameters.lncc_cell, 1);
  asked.similarity_parameters.lncc_cell = 2;
  EXPECT_EQ(resolved(asked, block(1)).similarity_parameters.lncc_cell, 2);
  asked.similarity_parameters.lncc_radius_voxels = 3;
  EXPECT_EQ(resolved(asked, plane(1)).similarity_parameters.lncc_radius_voxels, 3);
}

// core/measurements.md, "Regularisation".
TEST(ResolvedOptions, HoldOrderZeroMoreBesideFirstOrdersThatWereLetIn) {
  RegistrationOptions asked = automatic(SimilarityType::Lncc);
  asked.momenta.regularisation = 3e-4;
  EXPECT_DOUBLE_EQ(resolved(asked, plane(1)).momenta.regularisation_beside_first, 3e-3);
  asked.momenta.regularisation_beside_first = 5e-4;
  EXPECT_EQ(resolved(asked, plane(1)).momenta.regularisation_beside_first, 5e-4);
  for (Model model : {Model::Sliding, Model::Wendland1}) {
    const RegistrationOptions other = default_options(model, SimilarityType::Lncc, Preset::Balanced);
    EXPECT_EQ(resolved(other, plane(1)).momenta.regularisation_beside_first, 0);
  }
  EXPECT_EQ(resolved(automatic(SimilarityType::Ncc), plane(1)).momenta.regularisation_beside_first, 0);
}

TEST(ResolvedOptions, BoundWhatAutoMayHaveActiveInSpace) {
  EXPECT_EQ(resolved(automatic(SimilarityType::Lncc), plane(1)).momenta.most_active_share, 1);
  EXPECT_EQ(resolved(automatic(SimilarityType::Lncc), block(1)).momenta.most_active_share, 0.75);
  const RegistrationOptions sliding = default_options(Model::Sliding, SimilarityType::Lncc, Preset::Balanced);
  EXPECT_EQ(resolved(sliding, block(1)).momenta.most_active_share, 1);
}

// core/measurements.md, "Regularisation": only with ssd is another weight better in space than in a plane.
TEST(ResolvedOptions, RegulariseLessInSpaceWithSsd) {
  const auto in_plane = [](const RegistrationOptions& o) { return resolved(o, plane(1)).momenta.regularisation; };
  const auto in_space = [](const RegistrationOptions& o) { return resolved(o, block(1)).momenta.regularisation; };
  EXPECT_EQ(in_plane(automatic(SimilarityType::Ssd)), 3e-6);
  EXPECT_EQ(in_space(automatic(SimilarityType::Ssd)), 1e-6);
  RegistrationOptions asked = automatic(SimilarityType::Ssd);
  asked.momenta.regularisation = 2e-5;
  EXPECT_EQ(in_space(asked), 2e-5);
  for (const SimilarityType similarity : {SimilarityType::Lncc, SimilarityType::Ncc, SimilarityType::Mi}) {
    const RegistrationOptions by_default = automatic(similarity);
    RegistrationOptions zero = by_default;
    zero.momenta.regularisation = 0;
    EXPECT_GT(by_default.momenta.regularisation, 0);
    EXPECT_EQ(in_space(zero), by_default.momenta.regularisation);
    EXPECT_EQ(in_plane(by_default), by_default.momenta.regularisation);
  }
}

// Half the contrast: a quarter of the sparsity and half of order 0's weight beside first orders, as far as noise has no
// part in them. The finest level of `block` has voxels twice as wide, over which an image changes twice as much.
TEST(ResolvedOptions, FollowALowContrastWithSsd) {
  const RegistrationOptions asked = automatic(SimilarityType::Ssd);
  const double full = asked.momenta.full_contrast;
  ASSERT_GT(full, 0);
  const auto plain = resolved(asked, block(1)).momenta;
  ASSERT_EQ(resolved(asked, block(1)).pyramid.finest_level, 1);
  const auto at = [&](const ImageTraits& traits) { return resolved(asked, block(1), traits).momenta; };
  EXPECT_EQ(at({0, full}).sparsity, plain.sparsity);
  EXPECT_EQ(at({0, full / 2}).regularisation_beside_first, 0);
  EXPECT_EQ(at({0, full}).oriented_alone, 1);
  EXPECT_EQ(at({0, full / 4}).oriented_alone, 0);
  EXPECT_DOUBLE_EQ(at({0, full / 4}).sparsity, plain.sparsity / 4);
  EXPECT_DOUBLE_EQ(at({0, full / 4}).regularisation_beside_first, plain.regularisation / 2);
  EXPECT_EQ(at({0, full / 4}).regularisation, plain.regularisation);
  EXPECT_DOUBLE_EQ(at({0, 0}).sparsity, plain.sparsity / 16) << "a quarter of the contrast is the least that counts";
  // The level's noise is ssd_residual then: half of the weights is due to it.
  const double noise =
      asked.similarity_parameters.ssd_residual / noise_of_level(1.0, block(1), level_lattice(block(1), 1));
  EXPECT_DOUBLE_EQ(at({noise, full / 4}).sparsity, plain.sparsity * (0.25 + 1) / 2);
  EXPECT_DOUBLE_EQ(at({noise, full / 4}).regularisation_beside_first, plain.regularisation * (0.5 + 1) / 2);
}

// Beside a narrower scale the flow has sites so close that they follow it, but no fewer than without.
TEST(NarrowFlowLattice, IsAsFineAsTheNarrowKernelNeeds) {
  for (double spacing : {1.0, 0.7}) {
    const Lattice<3> image{{128, 120, 96}, {spacing, spacing, spacing}, {}};
    RegistrationOptions options = automatic(SimilarityType::Ncc);
    const auto at = [&](int level, int finest) { return narrow_flow_lattice(image, options, level, finest); };
    EXPECT_EQ(at(1, 1), coarsened(image, 2.5 * spacing)) << "1.25 voxels of scale 1";
    EXPECT_EQ(at(0, 0), image) << "1.25 voxels are nearer to one than to two";
    EXPECT_EQ(at(0, 1), level_lattice(image, 1)) << "no coarser than without";
    options.similarity = SimilarityType::Lncc;  // its narrow kernel is wider
    EXPECT_EQ(at(1, 1), level_lattice(image, 2));
    options = automatic(SimilarityType::Ncc);
    options.flow.coarsening = 0;
    EXPECT_EQ(at(1, 1), level_lattice(image, 1));
  }
}

// Half the contrast: without pairs to begin with a round has to go on until four times less is gained. Where these are
// kept, that is so for the first round of a level alone, down to the level's own tolerance over the root of a half, and
// never sooner than the other rounds; the last one has a smaller tolerance. The part of all this that is due to noise
// stays.
TEST(ResolvedOptions, FollowALowContrastWithTheEndsOfRounds) {
  RegistrationOptions asked = automatic(SimilarityType::Ssd);
  ASSERT_TRUE(asked.optimisation.keep_pairs);
  asked.optimisation.tolerance = 0.02;
  asked.optimisation.round_tolerance = 0.08;
  const auto at = [&](double share, double noise = 0) {
    return resolved(asked, block(1), {noise, share / 2 * asked.momenta.full_contrast}).optimisation;
  };
  EXPECT_EQ(at(1).first_round_tolerance, -1) << "as the others";
  EXPECT_NEAR(at(0.8).first_round_tolerance, 0.08 * 0.64, 1e-5);
  EXPECT_NEAR(at(0.5).first_round_tolerance, 0.02 * std::sqrt(2), 1e-5);
  EXPECT_NEAR(at(0.5).round_tolerance, 0.875 * 0.08, 1e-5);
  EXPECT_NEAR(at(0.5).tolerance, 0.56 * 0.02, 1e-5);
  EXPECT_NEAR(at(0.8).tolerance, 0.8 * 0.02, 1e-5);
  EXPECT_EQ(at(1).tolerance, 0.02);
  // The level's noise is ssd_residual then: half of what counts is due to it.
  const double noise =
      asked.similarity_parameters.ssd_residual / noise_of_level(1.0, block(1), level_lattice(block(1), 1));
  EXPECT_NEAR(at(0.5, noise).first_round_tolerance, 0.08 * (0.25 + 1) / 2, 1e-5);
  asked.optimisation.tolerance = 0.06;
  EXPECT_NEAR(at(0.5, noise).first_round_tolerance, 0.06 / std::sqrt((0.5 + 1) / 2), 1e-5);
  asked.optimisation.tolerance = 0.075;
  EXPECT_NEAR(at(0.5).first_round_tolerance, 0.875 * 0.08, 1e-5);
  asked.optimisation.keep_pairs = false;
  EXPECT_EQ(at(0.5).first_round_tolerance, -1) << "as the others";
  EXPECT_NEAR(at(0.5).round_tolerance, 0.02, 1e-5);
  asked.optimisation.first_round_tolerance = 0.3;
  EXPECT_EQ(at(0.5).first_round_tolerance, 0.3);
}

TEST(ResolvedOptions, FollowNoContrastWhereItIsSaidOtherwise) {
  RegistrationOptions asked = automatic(SimilarityType::Ssd);
  asked.momenta.regularisation_beside_first = 0.25;
  EXPECT_EQ(resolved(asked, block(1), {0, 0.01}).momenta.regularisation_beside_first, 0.25);
  const double sparsity = asked.momenta.sparsity;
  asked.momenta.oriented_alone = 1;
  EXPECT_EQ(resolved(asked, block(1), {0, 0.01}).momenta.oriented_alone, 1);
  asked.momenta.full_contrast = 0;
  EXPECT_EQ(resolved(asked, block(1), {0, 0.01}).momenta.sparsity, sparsity);
  RegistrationOptions other = default_options(Model::Sliding, SimilarityType::Lncc, Preset::Balanced);
  other.momenta.full_contrast = 0.04;
  other.momenta.sparsity_noise = 0;
  EXPECT_EQ(resolved(other, block(1), {0, 0.01}).momenta.sparsity, other.momenta.sparsity);
}

// Header: what is resolved stays as it is when resolved again, whatever the noise is said to be then.
TEST(ResolvedOptions, StayWhenResolvedAgain) {
  for (const Preset preset : {Preset::Fast, Preset::Balanced, Preset::Accurate})
    for (const double mm : {1.0, 3.0})
      for (const SimilarityType similarity : all_similarities()) {
        const RegistrationOptions once = resolved(automatic(similarity, preset), block(mm), {0.02, 0.005});
        const auto first = list_parameters(once), second = list_parameters(resolved(once, block(mm), {0.05, 0.003}));
        ASSERT_EQ(first.size(), second.size());
        for (std::size_t i = 0; i < first.size(); ++i) EXPECT_EQ(first[i].value, second[i].value) << first[i].name;
      }
}

}  // namespace
}  // namespace saltus
