// What noise alone makes of a gradient, and rounds that end where mostly noise pulls. Oracles: gradients of images with
// and without noise; the truth of phantoms.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "core/evaluation/field_error.h"
#include "core/registration/matching_objective.h"
#include "core/registration/narrower_scale.h"
#include "core/registration/scales.h"
#include "core/support/random.h"
#include "tests/support/phantom_pair.h"
#include "tests/support/random_fields.h"

namespace saltus {
namespace {

/// Another similarity of an image that has noise.
class Noisy final : public Similarity<2, double> {
 public:
  Noisy(std::unique_ptr<Similarity<2, double>> inner, std::size_t sites, double sd)
      : inner_(std::move(inner)), noise_(sites) {
    for (std::size_t i = 0; i < sites; ++i) noise_[i] = random_bits(0, {static_cast<std::int64_t>(i)}) & 1 ? sd : -sd;
  }
  double evaluate(const double* fixed, const double* warped, const double* weights, double* gradient,
                  double* weight_gradient) override {
    std::vector<double> noisy(warped, warped + noise_.size());
    for (std::size_t i = 0; i < noisy.size(); ++i) noisy[i] += noise_[i];
    return inner_->evaluate(fixed, noisy.data(), weights, gradient, weight_gradient);
  }

 private:
  std::unique_ptr<Similarity<2, double>> inner_;
  std::vector<double> noise_;
};

MatchingLevel<2, double> of_waves(const Lattice<2>& lattice) {
  MatchingLevel<2, double> level;
  level.lattice = lattice;
  level.fixed = testing::random_waves<2>(lattice, 1);
  level.moving = {lattice, testing::random_waves<2>(lattice, 2), Matrix<2>::Identity(), Vector<2>::Zero()};
  return level;
}

TEST(NoiseGradient, IsWhatNoiseChangesOfTheGradient) {
  MatchingLevel<2, double> level = of_waves({{19, 17}, {1, 1.25}, {}});
  level.similarity_weight = 0.7;
  level.divergence_weight = 0.3;  // of which noise knows nothing
  level.time_steps = 2;
  level.noise = 0.05;
  struct Case {
    SimilarityType type;
    Model model;
    bool has_masks;
    bool is_flow_coarse = false;  // as order 0 is
  };
  std::vector<Case> cases;
  for (SimilarityType type : {SimilarityType::Ssd, SimilarityType::Lncc})
    for (bool has_masks : {false, true}) {
      for (Model model : {Model::Gaussian, Model::Wendland1}) cases.push_back({type, model, has_masks});
      cases.push_back({type, Model::Gaussian, has_masks, true});
    }
  for (const auto& [type, model, has_masks, is_flow_coarse] : cases) {
    SCOPED_TRACE(to_string(type) + " " + to_string(model) + (has_masks ? ", masks" : "") +
                 (is_flow_coarse ? ", a coarser flow" : ""));
    level.fixed_weights.clear();
    level.moving_weights.samples.clear();
    if (has_masks) {
      level.fixed_weights = testing::random_values(level.lattice.sites(), 3);
      level.moving_weights = level.moving;
      level.moving_weights.samples = testing::random_waves<2>(level.lattice, 4);
      for (std::vector<double>* weights : {&level.fixed_weights, &level.moving_weights.samples})
        for (double& weight : *weights) weight = std::min(1.0, std::abs(weight) + 0.1);
    }
    RegistrationOptions options = default_options(model, type, Preset::Balanced);
    options.momenta.width_voxels = 4;
    options.momenta.scales = 1;
    options.momenta.finest_scale = 0;
    const Lattice<2> flow = level_lattice(level.lattice, is_flow_coarse ? options.flow.coarsening : 0);
    auto placed = make_scales<2, double>(level.lattice, resolved(options, level.lattice), {});
    const auto similarity = [&] {
      return make_similarity<2, double>(type, level.lattice, options.similarity_parameters, 1.0);
    };
    MatchingObjective<2, double> clean({placed[0].scale.get()}, level, similarity(), 1e-3, flow);
    MatchingObjective<2, double> noisy({placed[0].scale.get()}, level,
                                       std::make_unique<Noisy>(similarity(), level.lattice.sites(), level.noise), 1e-3,
                                       flow);
    const std::size_t size = clean.size();
    const std::vector<double> x = testing::random_values(size, 5, model == Model::Gaussian ? 0.1 : 1e-9);
    std::vector<double> found(size), found_p(size), with(size), with_p(size), without(size), without_p(size);
    noisy.evaluate(x, with, with_p);
    clean.evaluate(x, without, without_p);
    ASSERT_TRUE(clean.noise_gradient(x, found, found_p));
    double largest = 0, largest_p = 0;
    for (std::size_t i = 0; i < size; ++i) {
      largest = std::max(largest, std::abs(without[i]));
      largest_p = std::max(largest_p, std::abs(without_p[i]));
    }
    double most = 0;
    for (std::size_t i = 0; i < size; ++i) {
      ASSERT_NEAR(found[i], with[i] - without[i], 1e-12 * largest) << i;
      ASSERT_NEAR(found_p[i], with_p[i] - without_p[i], 1e-12 * largest_p) << i;
      most = std::max(most, std::abs(found[i]));
    }
    EXPECT_GT(most, (has_masks ? 1e-5 : 1e-4) * largest);

    // It leaves the objective as it was.
    std::vector<double> again(size), again_p(size);
    clean.evaluate(x, again, again_p);
    EXPECT_EQ(again, without);
    EXPECT_EQ(again_p, without_p);
  }
}

TEST(NoiseGradient, IsNotKnownWithoutNoise) {
  MatchingLevel<2, double> level = of_waves({{9, 8}, {1, 1}, {}});
  RegistrationOptions options = default_options(Model::Gaussian, SimilarityType::Ssd, Preset::Balanced);
  options.momenta.scales = 1;
  options.momenta.finest_scale = 0;
  auto placed = make_scales<2, double>(level.lattice, resolved(options, level.lattice), {});
  MatchingObjective<2, double> objective(
      {placed[0].scale.get()}, level,
      make_similarity<2, double>(SimilarityType::Ssd, level.lattice, options.similarity_parameters, 1.0), 0.0);
  const std::vector<double> x(objective.size(), 0.0);
  std::vector<double> gradient(x.size()), preconditioned(x.size());
  objective.evaluate(x, gradient, preconditioned);
  std::vector<double> untouched(x.size(), 7.0), untouched_p(x.size(), 8.0);
  EXPECT_FALSE(objective.noise_gradient(x, untouched, untouched_p));
  EXPECT_EQ(untouched, std::vector<double>(x.size(), 7.0));
  EXPECT_EQ(untouched_p, std::vector<double>(x.size(), 8.0));
}

// Oracle: an objective that has the other scale as well, with no momenta, and the same noise of its own. Its gradient
// is the kernel's of what pulls exactly where nothing moves yet.
TEST(PullOverNoise, IsWhatAnotherScaleWouldFeelBesideWhatNoiseMakesOfIt) {
  MatchingLevel<2, double> level = of_waves({{29, 27}, {1, 1.25}, {}});
  level.similarity_weight = 0.7;
  level.divergence_weight = 0.3;
  level.time_steps = 2;
  for (SimilarityType type : {SimilarityType::Ssd, SimilarityType::Lncc, SimilarityType::Mi}) {
    SCOPED_TRACE(to_string(type));
    RegistrationOptions options = default_options(Model::Gaussian, type, Preset::Balanced);
    options.momenta.width_voxels = 4;
    options.momenta.scales = 2;
    options.momenta.finest_scale = 0;
    options.momenta.regularisation = 1;
    options = resolved(options, level.lattice);
    auto placed = make_scales<2, double>(level.lattice, options);
    auto narrow = make_narrow_scale<2, double>(level.lattice, options, placed.back());
    std::vector<MomentumScale<2, double>*> scales;
    for (auto& scale : placed) scales.push_back(scale.scale.get());
    const Lattice<2> flow = level_lattice(level.lattice, options.flow.coarsening);
    const auto similarity = [&] {
      return make_similarity<2, double>(type, level.lattice, options.similarity_parameters, 1.0);
    };
    const double noise = 0.02;
    MatchingObjective<2, double> objective(scales, level, similarity(), 0, flow);
    const std::vector<double> x(objective.size(), 0.0);
    const PullOverNoise found = objective.pull_over_noise(x, 1, *narrow.scale, noise);

    MatchingLevel<2, double> noisy = level;
    noisy.noise = noise;
    scales.push_back(narrow.scale.get());
    MatchingObjective<2, double> both(scales, noisy, similarity(), 0, flow);
    const std::vector<double> none(both.size(), 0.0);
    std::vector<double> gradient(none.size()), preconditioned(none.size());
    const auto square = [&](std::size_t begin, std::size_t end) {
      return std::inner_product(&gradient[begin], &gradient[end - 1] + 1, &preconditioned[begin], 0.0);
    };
    const std::size_t end = x.size(), middle = placed[0].scale->field_size();
    both.evaluate(none, gradient, preconditioned);
    const double own = square(middle, end), other = square(end, none.size());
    ASSERT_TRUE(both.noise_gradient(none, gradient, preconditioned));
    EXPECT_NEAR(found.own, own / square(middle, end), 1e-9 * found.own);
    EXPECT_NEAR(found.other, other / square(end, none.size()), 1e-9 * found.other);
    EXPECT_GT(std::abs(found.own - found.other), 1e-3 * found.own);

    // What the penalty adds to it is no pull, and at a scale without momenta it adds nothing.
    std::vector<double> moved = testing::random_values(x.size(), 5, 0.1);
    const PullOverNoise there = objective.pull_over_noise(moved, 1, *narrow.scale, noise);
    moved.resize(none.size(), 0.0);
    const auto of_kernel = [&] {
      std::vector<double> velocity(narrow.scale->field_size());
      narrow.scale->synthesise(&preconditioned[end], nullptr, velocity.data());
      return std::inner_product(velocity.begin(), velocity.end(), &preconditioned[end], 0.0);
    };
    both.evaluate(moved, gradient, preconditioned);
    const double pull = of_kernel();
    both.noise_gradient(moved, gradient, preconditioned);
    EXPECT_NEAR(there.other, pull / of_kernel(), 1e-9 * there.other);
  }
}

struct Ended {
  int iterations = 0;
  double error = 0;
  RegistrationSummary summary;
};

Ended registered(const Phantom<2>& phantom, const RegistrationOptions& options) {
  const RegistrationResult<2> found = register_images<2>(testing::pair_of(phantom), options);
  Ended ended;
  for (const LevelSummary& level : found.summary.levels) ended.iterations += level.iterations;
  ended.error = summarise(endpoint_errors(found.displacement, phantom.displacement, {phantom.masks.valid})).mean;
  ended.summary = found.summary;
  return ended;
}

Phantom<2> smooth_scene(double noise, std::uint64_t seed) {
  PhantomOptions scene = default_phantom_options(PhantomKind::Smooth);
  scene.size = {96, 96, 1};
  scene.displacement_mm = 4;
  scene.noise = noise;
  scene.seed = seed;
  return make_phantom<2>(scene);
}

// Where most of what pulls is noise, more iterations fit the noise: fewer are better.
TEST(NoiseFloor, SavesIterationsAndNoAccuracyWhereThereIsNoise) {
  RegistrationOptions options = default_options(Model::Auto, SimilarityType::Lncc, Preset::Balanced);
  ASSERT_GT(options.optimisation.noise_tolerance, 0);
  RegistrationOptions without = options;
  without.optimisation.noise_tolerance = 0;
  double error[2] = {}, iterations[2] = {};
  int ended_at_noise = 0;
  for (std::uint64_t seed : {1, 2, 3, 4}) {
    const Phantom<2> phantom = smooth_scene(0.03, seed);
    const Ended with = registered(phantom, options), longer = registered(phantom, without);
    error[0] += longer.error, error[1] += with.error;
    iterations[0] += longer.iterations, iterations[1] += with.iterations;
    for (const LevelSummary& level : with.summary.levels)
      ended_at_noise += level.termination == Termination::NoiseFloor;
    for (const LevelSummary& level : longer.summary.levels) EXPECT_NE(level.termination, Termination::NoiseFloor);
  }
  EXPECT_GE(ended_at_noise, 4);
  EXPECT_LT(iterations[1], 0.8 * iterations[0]);
  EXPECT_LT(error[1], 1.02 * error[0]);
}

TEST(NoiseFloor, ChangesNothingWhereThereIsNone) {
  RegistrationOptions options = default_options(Model::Auto, SimilarityType::Lncc, Preset::Balanced);
  const Phantom<2> phantom = smooth_scene(0, 1);
  const Ended with = registered(phantom, options);
  options.optimisation.noise_tolerance = 0;
  const Ended without = registered(phantom, options);
  EXPECT_EQ(with.iterations, without.iterations);
  EXPECT_EQ(with.error, without.error);
}

// A level that begins where noise alone pulls more than the images' difference has nothing to do.
TEST(NoiseFloor, LeavesOutALevelThatBeginsThere) {
  const Phantom<2> phantom = smooth_scene(0.03, 1);
  RegistrationOptions options = default_options(Model::Auto, SimilarityType::Ssd, Preset::Balanced);
  options.momenta.first_order_shear = 1e9;
  options.optimisation.noise_tolerance = 1;
  options.similarity_parameters.noise = 0.5;
  options.momenta.sparsity_noise = 0;
  const Ended found = registered(phantom, options);
  ASSERT_GE(found.summary.levels.size(), 2u);
  EXPECT_EQ(found.summary.levels.back().iterations, 0);
  EXPECT_EQ(found.summary.levels.back().termination, Termination::NoiseFloor);
}

// The velocity of order 0 shows a slip where mostly noise begins to pull as it does later: first orders begin there,
// beside momenta that have not fitted noise.
TEST(NoiseFloor, IsWhereFirstOrdersThatWaitedBegin) {
  PhantomOptions scene = default_phantom_options(PhantomKind::Slip);
  scene.angle_deg = 20;
  const Phantom<2> phantom = make_phantom<2>(scene);
  RegistrationOptions options = default_options(Model::Auto, SimilarityType::Lncc, Preset::Balanced);
  ASSERT_TRUE(options.momenta.first_order_waits);
  options.optimisation.max_iterations = 40;
  const auto alone = [&](const RegistrationOptions& asked) {
    const RegistrationSummary summary = registered(phantom, asked).summary;
    EXPECT_EQ(summary.levels.back().decision, FirstOrderDecision::LetIn);
    return std::count_if(summary.history.begin(), summary.history.end(), [&](const IterationRecord& record) {
      return record.level == summary.levels.back().level && record.round == 1;
    });
  };
  const auto until_noise = alone(options);
  options.optimisation.noise_tolerance = 0;
  EXPECT_LT(until_noise, alone(options));
}

}  // namespace
}  // namespace saltus
