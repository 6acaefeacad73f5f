// Which rounds a level has, what their weights begin from, and when one ends that another follows.
#include "core/registration/sparsity_rounds.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/evaluation/field_error.h"
#include "core/momenta/reweighting.h"
#include "core/phantom/make_phantom.h"
#include "core/registration/interface_normals.h"
#include "core/registration/register_images.h"
#include "core/registration/scales.h"
#include "core/registration/working_set.h"
#include "core/support/errors.h"
#include "tests/support/phantom_pair.h"

namespace saltus {
namespace {

using Weights = SparsityRound::Weights;

std::vector<Weights> weights_of(const std::vector<SparsityRound>& rounds) {
  std::vector<Weights> weights;
  for (const SparsityRound& round : rounds) weights.push_back(round.weights);
  return weights;
}

TEST(SparsityRounds, HaveNoPathWhereACoarserLevelFoundFirstOrders) {
  RegistrationOptions::Momenta momenta;
  momenta.sparsity = 1e-3;
  momenta.sparsity_path = 2;
  momenta.reweighted_rounds = 1;
  momenta.first_order_waits = true;
  const auto rounds = sparsity_rounds(momenta, true, false);
  EXPECT_EQ(weights_of(rounds),
            (std::vector<Weights>{Weights::Even, Weights::Even, Weights::Even, Weights::Reweighted}));
  EXPECT_FALSE(rounds[0].lets_blocks_join);
  EXPECT_EQ(rounds[1].factor, 2);
  EXPECT_EQ(rounds[2].factor, 1);
  EXPECT_EQ(weights_of(sparsity_rounds(momenta, true, true)),
            (std::vector<Weights>{Weights::Even, Weights::Reweighted}));
  // Nothing but even weights to begin with.
  momenta.reweighted_rounds = 0;
  EXPECT_EQ(sparsity_rounds(momenta, true, true).size(), 3u);
  EXPECT_EQ(sparsity_rounds(momenta, false, true).size(), 1u);
}

TEST(SparsityRounds, BeginWithMoreSparsityOnlyWhereReweightedOnesFollow) {
  RegistrationOptions::Momenta momenta;
  momenta.sparsity = 1e-3;
  momenta.sparsity_path = 2;
  momenta.even_sparsity = 1.5;
  momenta.reweighted_rounds = 1;
  const auto rounds = sparsity_rounds(momenta, true, false);
  ASSERT_EQ(rounds.size(), 3u);
  EXPECT_EQ(rounds[0].factor, 3);
  EXPECT_EQ(rounds[1].factor, 1.5);
  EXPECT_EQ(rounds[2].factor, 1);
  momenta.reweighted_rounds = 0;
  EXPECT_EQ(sparsity_rounds(momenta, true, false).back().factor, 1);
}

TEST(SparsityRounds, BeginWithWeightsOfShearWhereOrderZeroWasAloneBefore) {
  RegistrationOptions::Momenta momenta;
  momenta.sparsity = 1e-3;
  momenta.sparsity_path = 3;
  momenta.reweighted_rounds = 2;
  momenta.first_order_waits = true;
  momenta.orientations = 9;
  momenta.oriented_alone = 2;
  momenta.shear_weights = 1;
  const auto rounds = sparsity_rounds(momenta, true, false);
  EXPECT_EQ(weights_of(rounds),
            (std::vector<Weights>{Weights::Even, Weights::OfShear, Weights::Reweighted, Weights::Reweighted}));
  EXPECT_FALSE(rounds[0].lets_blocks_join);
  EXPECT_TRUE(rounds[1].lets_blocks_join);
  // A coarser level has momenta to make weights from.
  EXPECT_EQ(weights_of(sparsity_rounds(momenta, true, true)),
            (std::vector<Weights>{Weights::Even, Weights::Reweighted, Weights::Reweighted}));
  momenta.shear_weights = 2;
  EXPECT_EQ(weights_of(sparsity_rounds(momenta, true, false)),
            (std::vector<Weights>{Weights::Even, Weights::OfShear, Weights::Reweighted}));
  EXPECT_EQ(weights_of(sparsity_rounds(momenta, true, true)),
            (std::vector<Weights>{Weights::Even, Weights::Reweighted, Weights::Reweighted}));
  momenta.reweighted_rounds = 0;
  momenta.debias = true;
  EXPECT_EQ(weights_of(sparsity_rounds(momenta, true, false)),
            (std::vector<Weights>{Weights::Even, Weights::OfShear, Weights::Debiased}));
  momenta.debias = false;
  const std::vector<Weights> path(4, Weights::Even);
  EXPECT_EQ(weights_of(sparsity_rounds(momenta, true, true)), path) << "which nothing else takes the place of";
  momenta.oriented_alone = 1;  // some have no such weights
  EXPECT_EQ(weights_of(sparsity_rounds(momenta, true, false)), path);
  momenta.oriented_alone = 2;
  momenta.first_order_waits = false;  // nothing shows how the velocity changes
  EXPECT_EQ(weights_of(sparsity_rounds(momenta, true, false)),
            (std::vector<Weights>{Weights::Even, Weights::Even, Weights::Even}));
}

/// Scales with first orders, coarsest first, each twice as fine as the one before.
struct Scales {
  Lattice<2> lattice{{24, 20}, {1, 1}, {}};
  std::vector<PlacedScale<2, double>> placed;
  std::vector<MomentumScale<2, double>*> scales;

  explicit Scales(int count = 2, int orientations = 0) {
    RegistrationOptions options = default_options(Model::Wendland1, SimilarityType::Ssd, Preset::Balanced);
    options.momenta.width_voxels = 4;
    options.momenta.scales = options.momenta.first_order_scales = count;
    options.momenta.orientations = orientations;
    options.momenta.oriented_width = 1;
    options.momenta.oriented_sparsity = 0.4;
    options.momenta.finest_scale = options.momenta.first_order_finest_scale = 0;
    options.momenta.regularisation = options.momenta.first_order_regularisation = 1e-3;
    placed = make_scales<2, double>(lattice, options, {});
    for (auto& scale : placed) scales.push_back(scale.scale.get());
  }
};

// What a scale without momenta is given: oracle, reweighted_factors of the other one's at the nearest sites.
TEST(SparsityWeights, OfAScaleWithoutMomentaComeFromOneThatHasThem) {
  Scales scene;
  ASSERT_EQ(scene.scales.size(), 2u);
  const int fine = scene.scales[0]->lattice().sites() > scene.scales[1]->lattice().sites() ? 0 : 1, coarse = 1 - fine;
  const Lattice<2>&from = scene.scales[coarse]->lattice(), &to = scene.scales[fine]->lattice();
  ASSERT_LT(from.sites(), to.sites());
  WorkingSet<2, double> set(scene.scales, 1e-3, 0.5);
  std::vector<double> x(set.size(), 0.0);
  const auto& ranges = set.sparsity();
  ASSERT_EQ(ranges.size(), 4u);  // by scale and axis, all blocks active
  const std::size_t site = 5 * static_cast<std::size_t>(from.size[0]) + 6;
  x[ranges[2 * coarse + 1].begin + 2 * site] = 0.7;  // m_1, along the first axis
  set.weigh({Weights::Reweighted, 1}, x);

  std::vector<double> first(2 * 2 * from.sites(), 0.0);
  first[2 * from.sites() + 2 * site] = 0.7;
  const auto expected = reweighted_factors<2>(from, momentum_sizes<2, double>(from, first.data(), 2));
  std::size_t favoured = 0;
  for (int field = 0; field < 2; ++field) {
    const std::vector<float>& own = set.weights()[2 * fine + field];
    ASSERT_EQ(own.size(), to.sites());
    EXPECT_EQ(set.weights()[2 * coarse + field], expected[field]) << "its own";
    for (int y = 0; y < to.size[1]; ++y)
      for (int i = 0; i < to.size[0]; ++i) {
        const auto nearest = [&](int axis, int k) {
          const double at = (to.offset[axis] + k * to.spacing[axis] - from.offset[axis]) / from.spacing[axis];
          return std::clamp(static_cast<int>(std::lround(at)), 0, from.size[axis] - 1);
        };
        const float there = expected[field][static_cast<std::size_t>(nearest(1, y)) * from.size[0] + nearest(0, i)];
        const float found = own[static_cast<std::size_t>(y) * to.size[0] + i];
        EXPECT_EQ(found, std::max(there, 0.6f));
        favoured += found < 1;
      }
  }
  EXPECT_GT(favoured, 20u);
  EXPECT_LT(favoured, 80u);
}

/// The mean place of what is cheaper than with even weights, in samples of the finest lattice; and how much that is.
std::pair<Vector<2>, int> favoured(const Lattice<2>& lattice, const float* factors) {
  Vector<2> sum = Vector<2>::Zero();
  int count = 0;
  for (int y = 0; y < lattice.size[1]; ++y)
    for (int x = 0; x < lattice.size[0]; ++x)
      if (factors[y * lattice.size[0] + x] < 1) {
        sum += Vector<2>(lattice.offset[0] + x * lattice.spacing[0], lattice.offset[1] + y * lattice.spacing[1]);
        ++count;
      }
  return {sum / std::max(1, count), count};
}

TEST(SparsityWeights, ComeFromTheNextCoarserScaleOfSeveral) {
  Scales scene(3);
  ASSERT_EQ(scene.scales.size(), 3u);
  const Lattice<2>&coarsest = scene.scales[0]->lattice(), &middle = scene.scales[1]->lattice(),
        &finest = scene.scales[2]->lattice();
  ASSERT_LT(coarsest.sites(), middle.sites());
  ASSERT_LT(middle.sites(), finest.sites());
  WorkingSet<2, double> set(scene.scales, 1e-3, 0.5);
  std::vector<double> x(set.size(), 0.0);
  x[set.sparsity()[0].begin] = 0.7;  // in one corner
  const int at[2] = {9, 7};          // and in the middle
  x[set.sparsity()[2].begin + 2 * static_cast<std::size_t>(at[1] * middle.size[0] + at[0])] = 0.7;
  set.weigh({Weights::Reweighted, 1}, x);
  const auto [place, count] = favoured(finest, set.weights()[4].data());
  EXPECT_GT(count, 4);
  for (int a = 0; a < 2; ++a) EXPECT_NEAR(place[a], middle.offset[a] + at[a] * middle.spacing[a], 1.0);
}

// Whatever its normal is, by all first orders of the coarser scale, those along the axes too.
TEST(SparsityWeights, OfElementsComeFromAllThatACoarserScaleHas) {
  Scales scene(2, 8);
  const Lattice<2>&coarse = scene.scales[0]->lattice(), &fine = scene.scales[1]->lattice();
  WorkingSet<2, double> set(scene.scales, 1e-3, 0.5);
  Field<double> velocity(2 * fine.sites());
  for (int y = 0; y < fine.size[1]; ++y)
    for (int x = 0; x < fine.size[0]; ++x)
      for (int c = 0; c < 2; ++c)
        velocity[2 * static_cast<std::size_t>(y * fine.size[0] + x) + c] =
            std::tanh((x + y - 22) / 2.0) * (c == 0 ? 1 : -1);
  set.turn(InterfaceNormals<2, double>(fine, velocity));
  ASSERT_FALSE(set.turned_elements()[1].empty());
  std::vector<double> x(set.size(), 0.0);
  const int at[2] = {6, 5};
  x[set.sparsity()[1].begin + 2 * static_cast<std::size_t>(at[1] * coarse.size[0] + at[0])] = 0.7;  // in m_2
  set.weigh({Weights::Reweighted, 1}, x);
  const std::vector<float>& elements = set.weights().back();  // of the finer scale, the same for all normals
  ASSERT_EQ(elements.size(), fine.sites());
  const auto [place, count] = favoured(fine, elements.data());
  EXPECT_GT(count, 10);
  for (int a = 0; a < 2; ++a) EXPECT_NEAR(place[a], coarse.offset[a] + at[a] * coarse.spacing[a], 1.0);
}

// Of elements, by what the structure tensor says; momenta along the axes have no normal that could tell.
TEST(SparsityWeights, FollowTheShearWhereTheVelocityIsToShowWhereElementsAre) {
  Scales scene(1, 8);
  const Lattice<2>& lattice = scene.scales[0]->lattice();
  WorkingSet<2, double> set(scene.scales, 1e-3, 0.5);
  Field<double> velocity(2 * lattice.sites());  // a slip that becomes less along y
  for (int y = 0; y < lattice.size[1]; ++y)
    for (int x = 0; x < lattice.size[0]; ++x)
      velocity[2 * static_cast<std::size_t>(y * lattice.size[0] + x) + 1] =
          std::tanh((x - 11.5) / 2.0) * (1 - 0.04 * y);
  const InterfaceNormals<2, double> interface(lattice, velocity);
  const std::vector<double> strengths = interface.on(lattice, true).strengths;
  set.turn(interface);
  EXPECT_THROW(set.weigh({Weights::OfShear, 1}, std::vector<double>(set.size(), 0.0)), std::logic_error);
  set.turn(interface, true);
  set.weigh({Weights::OfShear, 1}, std::vector<double>(set.size(), 0.0));
  ASSERT_EQ(set.weights().size(), 3u);
  EXPECT_TRUE(set.weights()[0].empty() && set.weights()[1].empty());
  const std::vector<float> elements = set.weights()[2];  // the same for all normals
  ASSERT_EQ(elements.size(), lattice.sites());
  for (std::size_t site = 0; site < elements.size(); ++site)
    EXPECT_FLOAT_EQ(elements[site], static_cast<float>(1 / (0.15 + 8 * std::pow(strengths[site], 4)))) << site;
  // Each element has that of its site, whatever its normal.
  const auto sites = static_cast<std::uint32_t>(lattice.sites());
  const std::vector<std::vector<std::uint32_t>> active = {{5, 11, 12, 300, 3 * sites + 11, 3 * sites + 40, 7 * sites}};
  set.set_active_elements(active);
  const std::vector<float>& own = set.sparsity()[2].factors;
  ASSERT_EQ(own.size(), active[0].size());
  for (std::size_t e = 0; e < own.size(); ++e) EXPECT_EQ(own[e], elements[active[0][e] % lattice.sites()]) << e;
  const auto [least, most] = std::minmax_element(elements.begin(), elements.end());
  EXPECT_FLOAT_EQ(*least, static_cast<float>(1 / 8.15)) << "where it changes most";
  EXPECT_FLOAT_EQ(*most, static_cast<float>(1 / 0.15)) << "where it hardly does";
  // Put back they are what they were.
  WorkingSet<2, double> restored(scene.scales, 1e-3, 0.5);
  restored.turn(interface);
  restored.restore_weights({Weights::OfShear, 1}, set.weights());
  restored.set_active_elements(active);
  EXPECT_EQ(restored.sparsity()[2].factors, own);
  // Said once: other weights, and turning again, begin anew.
  set.turn(interface);
  set.weigh({Weights::Even, 1}, std::vector<double>(set.size(), 0.0));
  for (const std::vector<float>& list : set.weights()) EXPECT_TRUE(list.empty());
}

// From the elements of the round before, each normal by itself; and those that are the same for all.
TEST(SparsityWeights, OfElementsAreThoseOfTheirNormals) {
  Scales scene(1, 8);
  const Lattice<2>& lattice = scene.scales[0]->lattice();
  const auto sites = static_cast<std::uint32_t>(lattice.sites());
  WorkingSet<2, double> set(scene.scales, 1e-3, 0.5);
  Field<double> velocity(2 * lattice.sites());
  for (std::size_t site = 0; site < lattice.sites(); ++site)
    velocity[2 * site + 1] = std::tanh((static_cast<double>(site % 24) - 11.5) / 2.0);
  set.turn(InterfaceNormals<2, double>(lattice, velocity));
  const std::vector<std::vector<std::uint32_t>> active = {{100, 3 * sites + 100, 3 * sites + 101, 7 * sites}};
  set.set_active_elements(active);
  std::vector<double> x(set.size(), 0.0);
  x[set.sparsity()[2].begin] = 0.7;  // the first of them alone
  set.weigh({Weights::Reweighted, 1}, x);
  const std::vector<float>& all = set.weights()[2];
  ASSERT_EQ(all.size(), 8 * lattice.sites());
  const std::vector<float> own = set.sparsity()[2].factors;
  ASSERT_EQ(own.size(), active[0].size());
  for (std::size_t e = 0; e < own.size(); ++e) EXPECT_EQ(own[e], all[active[0][e]]) << e;
  EXPECT_LT(own[0], 0.2f);
  EXPECT_GT(own[1], 6.0f) << "the same site, another normal";

  WorkingSet<2, double> restored(scene.scales, 1e-3, 0.5);
  restored.restore_weights({Weights::Reweighted, 1}, set.weights());
  restored.set_active_elements(active);
  EXPECT_EQ(restored.sparsity()[2].factors, own);
  std::vector<std::vector<float>> short_of_one = set.weights();
  short_of_one[2].pop_back();
  EXPECT_THROW(restored.restore_weights({Weights::Reweighted, 1}, short_of_one), InvalidInput);

  set.weigh({Weights::Even, 1.5}, x);
  EXPECT_EQ(set.weights()[2], std::vector<float>(lattice.sites(), 1.5f));
  EXPECT_EQ(set.sparsity()[2].factors, std::vector<float>(active[0].size(), 1.5f));
}

// Nothing moves, so nothing shows where elements might be, and there are none.
TEST(SparsityWeights, OfShearAreEvenWhereNothingMoves) {
  Scales scene(1, 8);
  const Lattice<2>& lattice = scene.scales[0]->lattice();
  WorkingSet<2, double> set(scene.scales, 1e-3, 0.5);
  set.turn(InterfaceNormals<2, double>(lattice, Field<double>(2 * lattice.sites())), true);
  set.weigh({Weights::OfShear, 1}, std::vector<double>(set.size(), 0.0));
  for (const std::vector<float>& list : set.weights()) EXPECT_TRUE(list.empty());
}

TEST(SparsityWeights, AreEvenWhereNoScaleHasMomenta) {
  Scales scene;
  WorkingSet<2, double> set(scene.scales, 1e-3, 0.5);
  set.weigh({Weights::Reweighted, 1}, std::vector<double>(set.size(), 0.0));
  for (const std::vector<float>& list : set.weights()) EXPECT_TRUE(list.empty());
}

// A finer scale says nothing of a coarser one.
TEST(SparsityWeights, OfACoarserScaleDoNotComeFromAFinerOne) {
  Scales scene;
  ASSERT_LT(scene.scales[0]->lattice().sites(), scene.scales[1]->lattice().sites());
  WorkingSet<2, double> set(scene.scales, 1e-3, 0.5);
  std::vector<double> x(set.size(), 0.0);
  x[set.sparsity()[2].begin + 40] = 0.7;
  set.weigh({Weights::Reweighted, 1}, x);
  EXPECT_TRUE(set.weights()[0].empty());
  EXPECT_FALSE(set.weights()[2].empty());
}

RegistrationInput<2> slip() {
  PhantomOptions options = default_phantom_options(PhantomKind::Slip);
  options.size = {64, 64, 1};
  return testing::pair_of(make_phantom<2>(options));
}

// One round less beside elements, whose weights order 0's velocity gives, and what slides is found as well.
TEST(ShearWeights, TakeTheRoundThatShowsWhereElementsAre) {
  PhantomOptions phantom = default_phantom_options(PhantomKind::Slip);
  phantom.dimension = 3;
  phantom.size = {40, 40, 40};
  phantom.slip_mm = 4;
  phantom.angle_deg = 30;
  phantom.noise = 0.01;
  const Phantom<3> slip = make_phantom<3>(phantom);
  RegistrationOptions options = default_options(Model::Auto, SimilarityType::Lncc, Preset::Balanced);
  options.threads = 1;
  options.pyramid.finest_level = 0;
  struct Found {
    LevelSummary level;
    double error_near = 0;  // sum over the sites
  };
  const auto with = [&](int shear_weights) {
    options.momenta.shear_weights = shear_weights;
    const RegistrationResult<3> result = register_images<3>(testing::pair_of(slip), options);
    Found found{result.summary.levels.back()};
    for (double error : endpoint_errors<3>(result.displacement, slip.displacement, slip.masks.near))
      found.error_near += error;
    return found;
  };
  const Found even = with(0), both = with(1), shear = with(2), usual = with(-1);
  for (const Found* found : {&even, &both, &shear, &usual}) {
    EXPECT_EQ(found->level.decision, FirstOrderDecision::LetIn);
    EXPECT_GT(found->level.oriented_elements, 10);
    EXPECT_LT(found->error_near, 1.05 * even.error_near);
  }
  EXPECT_EQ(even.level.rounds, 3);
  EXPECT_EQ(both.level.rounds, 3);
  EXPECT_EQ(shear.level.rounds, 2);
  EXPECT_NE(even.level.energy_after, both.level.energy_after);
  EXPECT_EQ(usual.level.energy_after, shear.level.energy_after);
}

/// Iterations of each round of the last level.
std::vector<int> iterations_of(const RegistrationSummary& summary) {
  std::vector<int> iterations(static_cast<std::size_t>(summary.levels.back().rounds));
  for (const IterationRecord& record : summary.history)
    if (record.level == summary.levels.back().level) ++iterations.at(static_cast<std::size_t>(record.round) - 1);
  return iterations;
}

TEST(RoundTolerance, EndsRoundsThatOthersFollow) {
  RegistrationOptions options = default_options(Model::Sliding, SimilarityType::Ssd, Preset::Balanced);
  options.threads = 1;
  options.pyramid.levels = 1;
  options.momenta.full_contrast = 0;
  options.optimisation.tolerance = 1e-3;
  options.optimisation.round_tolerance = 0;
  const std::vector<int> even = iterations_of(register_images<2>(slip(), options).summary);
  options.optimisation.round_tolerance = 1;
  const std::vector<int> ended = iterations_of(register_images<2>(slip(), options).summary);
  ASSERT_EQ(even.size(), 3u);
  ASSERT_EQ(ended.size(), 3u);
  EXPECT_GT(even[0], 20);
  for (int round : {0, 1}) EXPECT_LE(ended[round], 15) << "five iterations, and five after others have joined";
  EXPECT_GT(ended[2], 20) << "the last one goes to the end";
}

TEST(RoundTolerance, FollowsTheContrast) {
  const Lattice<2> image{{64, 64}, {1, 1}, {}};
  const RegistrationOptions asked = default_options(Model::Sliding, SimilarityType::Ssd, Preset::Balanced);
  const auto tolerance = [&](double contrast) {
    return resolved(asked, image, {0, contrast}).optimisation.round_tolerance;
  };
  EXPECT_EQ(tolerance(1), asked.optimisation.round_tolerance);
  EXPECT_LT(tolerance(0.25 * asked.momenta.full_contrast), 0.1 * asked.optimisation.round_tolerance);
}

TEST(RoundTolerance, IsWhatWasMeasured) {
  const Lattice<2> plane{{64, 64}, {1, 1}, {}};
  const Lattice<3> cube{{64, 64, 64}, {1, 1, 1}, {}};
  for (SimilarityType similarity : all_similarities()) {
    if (similarity == SimilarityType::Ssd) continue;
    RegistrationOptions asked = default_options(Model::Auto, similarity, Preset::Balanced);
    EXPECT_EQ(resolved(asked, plane).optimisation.round_tolerance, 0.1);
    EXPECT_EQ(resolved(asked, cube).optimisation.round_tolerance, similarity == SimilarityType::Ncc ? 0.1 : 0.5);
    asked.optimisation.round_tolerance = 0.25;
    EXPECT_EQ(resolved(asked, cube).optimisation.round_tolerance, 0.25);
  }
  // -1 is what would have been the default.
  for (Model model : {Model::Auto, Model::Sliding, Model::Wendland1})
    for (SimilarityType similarity : all_similarities())
      for (Preset preset : {Preset::Fast, Preset::Balanced, Preset::Accurate}) {
        RegistrationOptions asked = default_options(model, similarity, preset);
        const double usual = resolved(asked, cube).optimisation.round_tolerance;
        asked.optimisation.round_tolerance = -1;
        EXPECT_EQ(resolved(asked, cube).optimisation.round_tolerance, usual);
      }
}

// Order 0 that shows no slip goes on as long as asked, and not longer where a level is more exact anyhow.
TEST(LookTolerance, LetsOrderZeroSettleBeforeFirstOrdersAreAskedFor) {
  RegistrationOptions options = default_options(Model::Auto, SimilarityType::Ssd, Preset::Balanced);
  options.threads = 1;
  options.pyramid.levels = 1;
  options.momenta.first_order_shear = 1e9;
  const auto iterations = [&](double tolerance, double look_tolerance) {
    options.optimisation.tolerance = tolerance;
    options.optimisation.look_tolerance = look_tolerance;
    const LevelSummary level = register_images<2>(slip(), options).summary.levels.back();
    EXPECT_EQ(level.rounds, 1);
    EXPECT_EQ(level.decision, FirstOrderDecision::LeftOut);
    return level.iterations;
  };
  EXPECT_GT(iterations(0.5, 0.01), iterations(0.5, 0));
  EXPECT_EQ(iterations(0.01, 0.5), iterations(0.01, 0));
}

// A level that no first orders reach has order 0 alone as well, and what it leaves the finer one begins with.
TEST(LookTolerance, HoldsOnLevelsWithoutFirstOrders) {
  RegistrationOptions options = default_options(Model::Auto, SimilarityType::Lncc, Preset::Balanced);
  options.threads = 1;
  options.pyramid.levels = 2;
  options.optimisation.tolerance = 0.5;
  const auto iterations = [&](double look_tolerance) {
    options.optimisation.look_tolerance = look_tolerance;
    const LevelSummary level = register_images<2>(slip(), options).summary.levels.front();
    EXPECT_EQ(level.decision, FirstOrderDecision::None);
    EXPECT_EQ(level.rounds, 1);
    return level.iterations;
  };
  EXPECT_GT(iterations(0.01), iterations(0));
}

// Where first orders take part unasked the rounds after it go on with what order 0 has left.
TEST(LookTolerance, DoesNotHoldWhereNothingIsAsked) {
  RegistrationOptions options = default_options(Model::Sliding, SimilarityType::Lncc, Preset::Balanced);
  options.threads = 1;
  options.pyramid.levels = 1;
  options.optimisation.tolerance = 0.5;
  const auto iterations = [&](double look_tolerance) {
    options.optimisation.look_tolerance = look_tolerance;
    return register_images<2>(slip(), options).summary.levels.back().iterations;
  };
  EXPECT_EQ(iterations(0.001), iterations(0));
}

// Where first orders waited and nothing pulls at them, no round goes on with what has settled.
TEST(Rounds, AreLeftOutWhereNothingWouldJoin) {
  RegistrationOptions options = default_options(Model::Sliding, SimilarityType::Lncc, Preset::Balanced);
  options.threads = 1;
  options.momenta.sparsity = 1e6;
  for (const LevelSummary& level : register_images<2>(slip(), options).summary.levels) EXPECT_EQ(level.rounds, 1);
  options.momenta.sparsity = 1e-3;
  EXPECT_EQ(register_images<2>(slip(), options).summary.levels.back().rounds, 3);
  // The first weight of a path may be too large for any, and a later one not.
  options.momenta.sparsity_path = 12;
  const LevelSummary last = register_images<2>(slip(), options).summary.levels.back();
  EXPECT_EQ(last.rounds, 14);
  EXPECT_GT(last.active_block_share, 0);
}

// Elements have a weight of their own, so that the m_i do not speak for them.
TEST(Rounds, AreNotLeftOutWhereElementsMayJoin) {
  RegistrationOptions options = default_options(Model::Sliding, SimilarityType::Lncc, Preset::Balanced);
  options.threads = 1;
  options.momenta.sparsity = 1e6;
  options.momenta.orientations = 8;
  EXPECT_EQ(register_images<2>(slip(), options).summary.levels.back().rounds, 3);
}

}  // namespace
}  // namespace saltus
