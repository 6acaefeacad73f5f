// What `auto` and others choose before they have seen an image, and what they refuse.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <ostream>
#include <tuple>
#include <utility>

#include "core/registration/register_images.h"
#include "core/registration/scales.h"

namespace saltus {
namespace {

TEST(AutoChoices, ChoosesWhatDependsOnSimilarityAndDimension) {
  const Lattice<2> plane{{128, 128}, {1, 1}, {}};
  const Lattice<3> cube{{128, 128, 128}, {1, 1, 1}, {}};
  for (Model model : {Model::Auto, Model::Sliding, Model::Gaussian, Model::Wendland1, Model::Directional})
    for (SimilarityType similarity : {SimilarityType::Ssd, SimilarityType::Ncc, SimilarityType::Lncc}) {
      SCOPED_TRACE(to_string(model) + " " + to_string(similarity));
      RegistrationOptions options = default_options(model, similarity, Preset::Balanced);
      const RegistrationOptions flat = resolved(options, plane), deep = resolved(options, cube);
      if (similarity == SimilarityType::Lncc) {
        EXPECT_EQ(flat.flow.divergence_weight, 1);
        EXPECT_EQ(deep.flow.divergence_weight, 0.6);
      } else {
        EXPECT_EQ(flat.flow.divergence_weight, options.flow.divergence_weight);
        EXPECT_EQ(deep.flow.divergence_weight, options.flow.divergence_weight);
      }
      const bool is_sliding = model == Model::Auto || model == Model::Sliding;
      EXPECT_EQ(flat.optimisation.history, similarity != SimilarityType::Ssd || !is_sliding ? 6
                                           : model == Model::Auto                           ? 32
                                                                                            : 20);
      EXPECT_EQ(deep.optimisation.history, model == Model::Wendland1 ? 2 : 4);
      EXPECT_EQ(flat.momenta.narrow_width_shear, 0);
      const bool asks = model == Model::Auto && similarity == SimilarityType::Lncc;
      EXPECT_EQ(deep.momenta.narrow_width_shear, asks ? 4.8 : 0);
      EXPECT_EQ(resolved(deep, cube).momenta.narrow_width_shear, deep.momenta.narrow_width_shear);
      EXPECT_EQ(flat.momenta.narrower_pull, 0);
      EXPECT_EQ(deep.momenta.narrower_pull > 0, model == Model::Auto);
      EXPECT_EQ(resolved(deep, cube).momenta.narrower_pull, deep.momenta.narrower_pull);
      EXPECT_EQ(flat.flow.time_steps, 1);
      EXPECT_EQ(flat.momenta.coarser_regularisation, 1);
      EXPECT_EQ(flat.flow.map_steps, model != Model::Auto && similarity == SimilarityType::Ssd ? 3 : 2);
      RegistrationOptions given = options;  // what is given counts as it is
      given.momenta.kernel_widths = {{9, 1}, {4, 1}};
      EXPECT_EQ(resolved(given, cube).momenta.narrow_width_shear, 0);
      EXPECT_EQ(resolved(given, cube).momenta.narrower_pull, 0);
      given = options;
      given.momenta.width_voxels = 8;
      EXPECT_EQ(resolved(given, cube).momenta.narrow_width_shear, 0);
      EXPECT_EQ(resolved(given, cube).momenta.narrower_pull, 0);
      given = options;  // nothing is asked of order 0 then
      given.momenta.first_order_shear = 0;
      EXPECT_EQ(resolved(given, cube).momenta.narrower_pull, 0);
      given = options;  // as measured, also where another value is the default
      given.flow.divergence_weight = -1;
      EXPECT_EQ(resolved(given, cube).flow.divergence_weight, deep.flow.divergence_weight);
      given.optimisation.history = 7;
      EXPECT_EQ(resolved(given, cube).optimisation.history, 7);
    }
}

TEST(AutoChoices, ChoosesItsElementsBySimilarityDimensionAndContrast) {
  const Lattice<2> plane{{128, 128}, {1, 1}, {}};
  const Lattice<3> cube{{128, 128, 128}, {1, 1, 1}, {}};
  for (SimilarityType similarity : all_similarities()) {
    SCOPED_TRACE(to_string(similarity));
    const RegistrationOptions options = default_options(Model::Auto, similarity, Preset::Balanced);
    const auto flat = resolved(options, plane).momenta, deep = resolved(options, cube).momenta;
    const bool is_alone =
        similarity != SimilarityType::Ssd && similarity != SimilarityType::Ncc && similarity != SimilarityType::Lncc;
    EXPECT_EQ(std::make_tuple(flat.oblique_share, flat.oriented_alone, flat.oriented_sparsity, flat.oriented_width),
              is_alone ? std::make_tuple(0.0, 2, 0.4, 1.0) : std::make_tuple(0.7, 1, 0.4, 1.0));
    const bool is_narrow = similarity != SimilarityType::Ssd;
    EXPECT_EQ(std::make_tuple(deep.oblique_share, deep.oriented_alone, deep.oriented_sparsity, deep.oriented_width),
              is_narrow ? std::make_tuple(0.0, 2, 0.5, 0.5) : std::make_tuple(0.7, 1, 0.4, 1.0));
  }
  // With ssd the width goes with the contrast, down to its least; what is given stays.
  RegistrationOptions options = default_options(Model::Auto, SimilarityType::Ssd, Preset::Balanced);
  const auto width_at = [&](double share) {
    return resolved(options, plane, {0, share * options.momenta.full_contrast}).momenta.oriented_width;
  };
  EXPECT_EQ(width_at(1.5), 1);
  EXPECT_NEAR(width_at(0.6), 0.6, 1e-3);
  EXPECT_EQ(width_at(0.01), 0.35);
  options.momenta.oriented_width = 0.8;
  EXPECT_EQ(width_at(0.01), 0.8);
}

// Without them even weights leave most blocks and elements active.
TEST(AutoChoices, MakesWeightsFromTheMomentaFound) {
  for (Model model : {Model::Auto, Model::Sliding})
    for (SimilarityType similarity : all_similarities())
      for (Preset preset : all_presets())
        EXPECT_EQ(default_options(model, similarity, preset).momenta.reweighted_rounds,
                  similarity == SimilarityType::Ssd ? 2 : 1)
            << to_string(model) << " " << to_string(similarity) << " " << to_string(preset);
}

// Measured: core/measurements.md, "Time steps" and "Finer images".
TEST(AutoChoices, TakesOneTimeStepWhereASecondBringsNothing) {
  for (Model model : all_models())
    for (SimilarityType similarity : all_similarities())
      for (Preset preset : all_presets()) {
        const bool is_one = preset != Preset::Accurate || (model == Model::Auto && similarity != SimilarityType::Ssd);
        EXPECT_EQ(default_options(model, similarity, preset).flow.time_steps, is_one ? 1 : 2)
            << to_string(model) << " " << to_string(similarity) << " " << to_string(preset);
      }
}

TEST(AutoChoices, TakesFirstWeightsFromTheShearWhereThatWasMeasured) {
  const Lattice<2> plane{{128, 128}, {1, 1}, {}};
  const Lattice<3> cube{{128, 128, 128}, {1, 1, 1}, {}};
  for (SimilarityType similarity : all_similarities())
    for (Preset preset : all_presets()) {
      SCOPED_TRACE(to_string(similarity) + " " + to_string(preset));
      const auto weights = [&](RegistrationOptions options, const auto& lattice) {
        EXPECT_TRUE(problems(options).empty());
        return resolved(options, lattice).momenta.shear_weights;
      };
      const RegistrationOptions usual = default_options(Model::Auto, similarity, preset);
      const int expected = similarity == SimilarityType::Ssd ? 0 : 2;
      EXPECT_EQ(weights(usual, plane), 0);
      EXPECT_EQ(weights(usual, cube), expected);
      EXPECT_EQ(weights(default_options(Model::Sliding, similarity, preset), cube), 0);
      RegistrationOptions given = usual;
      given.momenta.reweighted_rounds = 0;  // even weights to the end, then
      EXPECT_EQ(weights(given, cube), 0);
      given = usual;
      given.momenta.orientations = 0;
      EXPECT_EQ(weights(given, cube), 0);
      given = usual;
      given.momenta.oriented_alone = 0;
      EXPECT_EQ(weights(given, cube), 0);
      given = usual;
      given.momenta.sparsity_path = 2;  // which would not be gone along
      EXPECT_EQ(weights(given, cube), 0);
      given = usual;
      given.momenta.even_sparsity = 3;
      EXPECT_EQ(weights(given, cube), 0);
      given = usual;
      given.momenta.first_order_waits = true;
      given.momenta.shear_weights = 1;
      given.momenta.oriented_alone = 2;
      EXPECT_EQ(weights(given, plane), 1);
      RegistrationOptions beside_axes = given;
      beside_axes.model = Model::Wendland1;
      EXPECT_THAT(problems(beside_axes), ::testing::Contains(::testing::HasSubstr("with model wendland1")));
      given.momenta.oriented_alone = 1;
      EXPECT_THAT(problems(given), ::testing::ElementsAre(::testing::HasSubstr(
                                       "shear_weights is 1 with model auto, orientations -1 and oriented_alone 1")));
      given.momenta.oriented_alone = 2;
      given.momenta.orientations = 0;
      EXPECT_THAT(problems(given), ::testing::ElementsAre(::testing::HasSubstr(
                                       "shear_weights is 1 with model auto, orientations 0 and oriented_alone 2")));
      given.momenta.orientations = -1;
      given.momenta.first_order_waits = false;
      EXPECT_THAT(problems(given),
                  ::testing::ElementsAre(::testing::HasSubstr("shear_weights is 1 and first_order_waits is false")));
    }
}

TEST(AutoChoices, AsksForANarrowerScaleWhereThatWasMeasured) {
  const Lattice<3> cube{{128, 128, 128}, {1, 1, 1}, {}};
  const std::map<SimilarityType, double> measured = {{SimilarityType::Ssd, 140}, {SimilarityType::Ncc, 40},
                                                     {SimilarityType::Lncc, 5},  {SimilarityType::Mi, 11},
                                                     {SimilarityType::Ngf, 3.4}, {SimilarityType::Mind, 0.3}};
  for (const auto& [similarity, expected] : measured)
    for (Preset preset : all_presets()) {
      const bool is_ssd = similarity == SimilarityType::Ssd;
      RegistrationOptions options = default_options(Model::Auto, similarity, preset);
      EXPECT_EQ(resolved(options, cube).momenta.narrower_pull,
                preset == Preset::Fast || (is_ssd && preset == Preset::Accurate) ? 0 : expected)
          << to_string(similarity) << " " << to_string(preset);
      options.flow.coarsening = 2;  // widths were measured with 1
      EXPECT_EQ(resolved(options, cube).momenta.narrower_pull, 0);
    }
  RegistrationOptions options = default_options(Model::Auto, SimilarityType::Lncc, Preset::Balanced);
  options.momenta.narrower_pull = 3.5;
  EXPECT_TRUE(problems(options).empty());
  options.momenta.first_order_shear = options.momenta.plain_shear = 0;
  EXPECT_THAT(problems(options),
              ::testing::ElementsAre(::testing::HasSubstr("narrower_pull is 3.5 and first_order_shear is 0")));
}

TEST(AutoChoices, LetsCoarserScalesMoveFarWhereThatWasMeasured) {
  for (Model model : {Model::Auto, Model::Sliding, Model::Gaussian, Model::Wendland})
    for (SimilarityType similarity : {SimilarityType::Mi, SimilarityType::Ngf, SimilarityType::Mind})
      EXPECT_EQ(default_options(model, similarity, Preset::Balanced).momenta.coarser_regularisation, 0.25)
          << to_string(model) << " " << to_string(similarity);
}

struct Held {  // how many times as much order 0 weighs beside first orders; 0: no other than otherwise
  double beside_first, beside_plain;
  bool operator==(const Held&) const = default;
};
void PrintTo(const Held& held, std::ostream* stream) { *stream << held.beside_first << ", " << held.beside_plain; }

template <int Dim>
Held held(const RegistrationOptions& options, const Lattice<Dim>& image) {
  const RegistrationOptions::Momenta momenta = resolved(options, image).momenta;
  const auto again = resolved(resolved(options, image), image).momenta;
  EXPECT_EQ(again.regularisation_beside_first, momenta.regularisation_beside_first);
  EXPECT_EQ(again.regularisation_beside_plain, momenta.regularisation_beside_plain);
  EXPECT_EQ(again.first_order_shear, momenta.first_order_shear);
  EXPECT_EQ(again.plain_shear, momenta.plain_shear);
  EXPECT_EQ(again.settled_plain_shear, momenta.settled_plain_shear);
  const auto times = [&](double weight) { return std::round(1e6 * weight / momenta.regularisation) / 1e6; };
  return {times(momenta.regularisation_beside_first), times(momenta.regularisation_beside_plain)};
}

TEST(AutoChoices, HoldsOrderZeroMoreBesideFirstOrders) {
  const Lattice<2> plane{{128, 128}, {1, 1}, {}};
  const Lattice<3> cube{{128, 128, 128}, {1, 1, 1}, {}};
  struct Measured {
    Held in_plane, in_space, told_in_space;
  };
  const std::map<SimilarityType, Measured> measured = {
      {SimilarityType::Ssd, {{0, 0}, {0, 0}, {0, 0}}},     {SimilarityType::Ncc, {{0, 0}, {0, 0}, {0, 0}}},
      {SimilarityType::Lncc, {{10, 0}, {10, 0}, {5, 10}}}, {SimilarityType::Mi, {{3, 0}, {3, 0}, {3, 0}}},
      {SimilarityType::Ngf, {{3, 0}, {3, 0}, {0, 3}}},     {SimilarityType::Mind, {{2, 0}, {0, 0}, {0.5, 1}}}};
  for (const auto& [similarity, expected] : measured) {
    SCOPED_TRACE(to_string(similarity));
    const RegistrationOptions fast = default_options(Model::Auto, similarity, Preset::Fast);
    EXPECT_EQ(held(fast, plane), (Held{0, 0})) << "fast, where order 0 has not settled";
    EXPECT_EQ(held(fast, cube), (Held{0, 0}));
    const RegistrationOptions accurate = default_options(Model::Auto, similarity, Preset::Accurate);
    EXPECT_EQ(held(accurate, plane), expected.in_plane);
    EXPECT_EQ(held(accurate, cube), expected.told_in_space);
    RegistrationOptions options = default_options(Model::Auto, similarity, Preset::Balanced);
    EXPECT_EQ(held(options, plane), expected.in_plane);
    EXPECT_EQ(held(options, cube), expected.told_in_space);
    // What is given counts as it is, for plain slips as well where nothing else is said of them.
    const double alone = resolved(options, cube).momenta.regularisation;
    options.momenta.regularisation_beside_first = 2.5 * alone;
    EXPECT_EQ(held(options, cube), (Held{2.5, 0}));
    options.momenta.regularisation_beside_plain = 3.5 * alone;
    EXPECT_EQ(held(options, cube), (Held{2.5, 3.5}));
    options.momenta.regularisation_beside_first = 0;
    EXPECT_EQ(held(options, cube), (Held{expected.told_in_space.beside_first, 3.5}));
    options.momenta.regularisation_beside_plain = 0;
    options.momenta.first_order_shear = 0;  // nobody is asked whether it is plain
    EXPECT_EQ(held(options, cube), expected.in_space);
    EXPECT_EQ(held(default_options(Model::Sliding, similarity, Preset::Balanced), cube), (Held{0, 0}));
  }
}

// Elements are where a round before shows an interface: one that nothing comes before would have none.
TEST(AutoChoices, RefusesElementsAloneThatNothingComesBefore) {
  RegistrationOptions options = default_options(Model::Sliding, SimilarityType::Ssd, Preset::Balanced);
  options.momenta.orientations = 9;
  options.momenta.oriented_alone = 2;
  EXPECT_TRUE(problems(options).empty());
  options.momenta.reweighted_rounds = 0;
  EXPECT_THAT(problems(options), ::testing::ElementsAre(::testing::HasSubstr("oriented_alone is 2")));
  options.momenta.first_order_waits = true;
  EXPECT_TRUE(problems(options).empty());
}

TEST(AutoChoices, RefusesWhatIsBelowNothingButStandsForNoMeasure) {
  RegistrationOptions options = default_options(Model::Auto, SimilarityType::Lncc, Preset::Balanced);
  options.momenta.oblique_share = -0.5;
  options.momenta.narrow_width_shear = -0.25;
  options.flow.divergence_weight = -0.75;
  options.momenta.plain_shear = -2;
  options.momenta.settled_plain_shear = -3;
  options.momenta.finer_shear = -0.375;
  options.momenta.quick_share = -0.4375;
  options.momenta.quick_tolerance = -0.5625;
  options.momenta.narrower_pull = -0.625;
  options.optimisation.round_tolerance = -0.125;
  options.optimisation.first_round_tolerance = -0.25;
  EXPECT_THAT(problems(options),
              ::testing::UnorderedElementsAre(
                  ::testing::HasSubstr("oblique_share is -0.5"), ::testing::HasSubstr("narrow_width_shear is -0.25"),
                  ::testing::HasSubstr("divergence_weight is -0.75"), ::testing::HasSubstr("r plain_shear is -2"),
                  ::testing::HasSubstr("settled_plain_shear is -3"), ::testing::HasSubstr("finer_shear is -0.375"),
                  ::testing::HasSubstr("quick_share is -0.4375"), ::testing::HasSubstr("quick_tolerance is -0.5625"),
                  ::testing::HasSubstr("narrower_pull is -0.625"), ::testing::HasSubstr(" round_tolerance is -0.125"),
                  ::testing::HasSubstr("first_round_tolerance is -0.25")));
}

TEST(AutoChoices, HasOrientedMomentaOnlyWhereTheyAreCarried) {
  RegistrationOptions options = default_options(Model::Auto, SimilarityType::Ssd, Preset::Balanced);
  const Lattice<2> plane{{128, 128}, {1, 1}, {}};
  const Lattice<3> cube{{128, 128, 128}, {1, 1, 1}, {}};
  EXPECT_EQ(resolved(options, plane).momenta.orientations, 8);
  EXPECT_EQ(resolved(options, cube).momenta.orientations, 9);
  options.flow.evolution = Evolution::Exact;
  EXPECT_TRUE(problems(options).empty());
  EXPECT_EQ(resolved(options, plane).momenta.orientations, 0);
}

template <int Dim>
void expect_momenta_along_axes(const RegistrationOptions& options, const Lattice<Dim>& lattice) {
  EXPECT_TRUE(problems(options).empty());
  const RegistrationOptions used = resolved(options, lattice);
  EXPECT_EQ(used.momenta.orientations, 0);
  EXPECT_FALSE(has_oriented_alone(used.momenta));
  bool has_any = false;
  for (const PlacedScale<Dim, float>& placed : make_scales<Dim, float>(lattice, used)) {
    EXPECT_EQ(placed.scale->can_slide(), placed.scale->has_first_order());
    has_any |= placed.scale->has_first_order();
  }
  EXPECT_TRUE(has_any);
}

// Elements that would stand alone, were there any, take nothing from momenta along the axes.
TEST(AutoChoices, HasMomentaAlongTheAxesWhereThereAreNoOrientedOnes) {
  for (SimilarityType similarity : all_similarities()) {
    SCOPED_TRACE(to_string(similarity));
    const RegistrationOptions usual = default_options(Model::Auto, similarity, Preset::Balanced);
    std::vector<RegistrationOptions> asked(4, usual);
    asked[0].flow.evolution = Evolution::Exact;
    asked[1].flow.evolution = Evolution::PerOrder;
    asked[2].momenta.orientations = 0;
    asked[3].momenta.sparsity = 0;
    for (const RegistrationOptions& options : asked) {
      expect_momenta_along_axes(options, Lattice<2>{{64, 64}, {1, 1}, {}});
      expect_momenta_along_axes(options, Lattice<3>{{32, 32, 32}, {1, 1, 1}, {}});
    }
  }
}

TEST(AutoChoices, RefusesASimpleShearBelowNoneAtAll) {
  RegistrationOptions options = default_options(Model::Auto, SimilarityType::Ssd, Preset::Balanced);
  options.momenta.first_order_shear = -0.5;
  EXPECT_THAT(problems(options), ::testing::ElementsAre(::testing::HasSubstr("first_order_shear is -0.5")));
  options = default_options(Model::Auto, SimilarityType::Ssd, Preset::Balanced);
  options.momenta.first_order_scales = options.momenta.orientations = 0;  // nothing that could be left out
  EXPECT_TRUE(problems(resolved(options, Lattice<2>{{64, 64}, {1, 1}, {}})).empty());
}

// Order 0 alone is cheap where first orders are asked for first; nobody else goes on for longer (core/measurements.md,
// "Stopping").
TEST(AutoChoices, SettlesOrderZeroForLonger) {
  const auto look_tolerance = [](Model model, SimilarityType similarity) {
    return default_options(model, similarity, Preset::Balanced).optimisation.look_tolerance;
  };
  for (SimilarityType similarity : all_similarities())
    for (Preset preset : {Preset::Fast, Preset::Balanced}) {
      const RegistrationOptions::Optimisation asked = default_options(Model::Auto, similarity, preset).optimisation;
      EXPECT_GT(asked.look_tolerance, 0) << to_string(similarity);
      EXPECT_LT(asked.look_tolerance, 0.7 * asked.tolerance) << to_string(similarity);
    }
  EXPECT_EQ(look_tolerance(Model::Auto, SimilarityType::Lncc), 0.015);
  // What order 0 leaves to rounds with first orders, ngf's have to go on with.
  for (const auto& [similarity, tolerance] :
       {std::pair(SimilarityType::Lncc, 0.04), std::pair(SimilarityType::Mi, 0.04),
        std::pair(SimilarityType::Ngf, 0.03), std::pair(SimilarityType::Mind, 0.04),
        std::pair(SimilarityType::Ncc, 0.025)})
    EXPECT_EQ(default_options(Model::Auto, similarity, Preset::Balanced).optimisation.tolerance, tolerance)
        << to_string(similarity);
  EXPECT_EQ(look_tolerance(Model::Auto, SimilarityType::Mi), 0.025);
  EXPECT_EQ(look_tolerance(Model::Auto, SimilarityType::Mind), 0.025);
  EXPECT_EQ(look_tolerance(Model::Sliding, SimilarityType::Lncc), 0);
}

}  // namespace
}  // namespace saltus
