#include "core/registration/register_images.h"

#include <gtest/gtest.h>
#include <omp.h>

#include <cmath>

#include "tests/support/analytic_scene.h"
#include "tests/support/many_threads.h"
#include "tests/support/same_result.h"

namespace saltus {
namespace {

using testing::AnalyticScene;
using testing::centred_grid;
using testing::expect_same_bits;
using testing::for_voxels;
using testing::sampled;
using testing::vector_at;

ImageGrid<2> plane() { return centred_grid<2>({48, 44}, {1, 1}, Matrix<2>::Identity()); }
ImageGrid<3> block() { return centred_grid<3>({20, 18, 12}, {1, 1, 1.5}, Matrix<3>::Identity()); }

/// The right half of the scene slides up and the left half down.
template <int Dim>
RegistrationInput<Dim> sliding_pair(const ImageGrid<Dim>& grid, double slip) {
  const AnalyticScene<Dim> scene(14, 2.5, 80, 5);
  RegistrationInput<Dim> input;
  input.moving = sampled<Dim>(grid, scene);
  input.fixed = sampled<Dim>(grid, [&](Vector<Dim> x) {
    x[1] += x[0] > 0 ? slip : -slip;
    return scene(x);
  });
  return input;
}

RegistrationOptions quick(Model model, SimilarityType similarity, int iterations = 8) {
  RegistrationOptions options = default_options(model, similarity, Preset::Balanced);
  options.pyramid.levels = 2;
  options.pyramid.finest_level = 0;
  options.momenta.width_voxels = 5;
  options.momenta.scales = 2;
  options.optimisation.max_iterations = iterations;
  return options;
}

// Oracle: the same bits, whatever the number of threads.
TEST(RegisterImages, DoesNotDependOnTheNumberOfThreads) {
  const testing::ManyThreads many;
  RegistrationInput<3> input = sliding_pair<3>(block(), 1.0);
  input.fixed_mask = Volume<3>(block(), 1.0f);
  for (std::size_t i = 0; i < 900; ++i) input.fixed_mask->samples[i] = 0;
  input.moving_mask = input.fixed_mask;
  for (Evolution evolution : {Evolution::Carried, Evolution::Exact}) {
    RegistrationOptions options = quick(Model::Sliding, SimilarityType::Lncc, 5);
    options.momenta.sparsity = 1e-4;
    options.flow.divergence_weight = 0.05;
    options.flow.evolution = evolution;
    options.threads = 1;
    const RegistrationResult<3> alone = register_images<3>(input, options);
    EXPECT_GT(alone.summary.history.size(), 3u);
    EXPECT_GT(alone.summary.active_first_order_share, 0);
    for (int threads : {2, 8}) {
      SCOPED_TRACE(threads);
      options.threads = threads;
      expect_same_bits(register_images<3>(input, options), alone);
    }
  }
}

// Where both images are black there is nothing to compare: leaving it out changes the order of sums and no more.
// Oracle: the same run on all of both images.
TEST(RegisterImages, FindsTheSameInTheRegionThatShowsSomething) {
  RegistrationInput<2> input;
  const AnalyticScene<2> scene(14, 2.5, 80, 5);
  const ImageGrid<2> grid = centred_grid<2>({112, 96}, {1, 1}, Matrix<2>::Identity());
  const auto lit = [&](const Vector<2>& x) {
    const double r = x.norm() / 22;
    return r < 1 ? std::pow(1 - r * r, 2) * (2 + scene(x) / 80) : 0.0;
  };
  input.moving = sampled<2>(grid, lit);
  input.fixed = sampled<2>(grid, [&](const Vector<2>& x) { return lit(x + Vector<2>(0.7, -1.1)); });
  RegistrationOptions options = quick(Model::Gaussian, SimilarityType::Ssd, 20);
  const RegistrationResult<2> all = register_images<2>(input, options);
  EXPECT_TRUE(all.summary.region.empty());
  options.pyramid.region_margin = 8;
  const RegistrationResult<2> part = register_images<2>(input, options);
  ASSERT_EQ(part.summary.region.size(), 2u);
  double largest = 0, motion = 0;
  for (std::size_t i = 0; i < all.displacement.samples.size(); ++i) {
    largest = std::max(largest, std::abs(double(all.displacement.samples[i]) - part.displacement.samples[i]));
    motion = std::max(motion, std::abs(double(all.displacement.samples[i])));
  }
  EXPECT_GT(motion, 0.8);
  EXPECT_LT(largest, 2e-3);
}

// Header of RegistrationOptions: 0 is all that the process may use, also after a run that was given fewer.
TEST(RegisterImages, LeavesTheThreadsOfTheProcessAsTheyWere) {
  const int before = omp_get_max_threads();
  omp_set_num_threads(3);
  RegistrationOptions options = quick(Model::Gaussian, SimilarityType::Ssd, 1);
  options.threads = 1;
  register_images<2>(sliding_pair<2>(plane(), 1.0), options);
  EXPECT_EQ(omp_get_max_threads(), 3);
  EXPECT_THROW(
      register_images<2>(sliding_pair<2>(plane(), 1.0), options, [](const Progress&) -> ProgressAnswer { throw 7; }),
      int);
  EXPECT_EQ(omp_get_max_threads(), 3);
  omp_set_num_threads(before);
}

/// Runs until `enough` says so, and checks what every stopped run owes.
template <class Enough>
RegistrationResult<2> stopped_run(const RegistrationInput<2>& input, Enough&& enough) {
  int calls_after = -1;
  RegistrationResult<2> result =
      register_images<2>(input, quick(Model::Wendland1, SimilarityType::Ssd), [&](const Progress& now) {
        EXPECT_GE(now.fraction, 0);
        EXPECT_LE(now.fraction, 1);
        if (calls_after < 0 && !enough(now)) return ProgressAnswer::Continue;
        ++calls_after;
        return ProgressAnswer::Stop;
      });
  EXPECT_EQ(calls_after, 0) << "asked again after it said stop";
  EXPECT_EQ(result.summary.termination, Termination::Stopped);
  EXPECT_EQ(result.summary.levels.back().termination, Termination::Stopped);
  EXPECT_EQ(result.displacement.grid, input.fixed.grid);
  for (float u : result.displacement.samples) EXPECT_TRUE(std::isfinite(u));
  return result;
}

TEST(RegisterImages, StopsWhenTheCallbackSaysSoAndReturnsWhatItHas) {
  const RegistrationInput<2> input = sliding_pair<2>(plane(), 2.0);
  const RegistrationResult<2> at_once = stopped_run(input, [](const Progress&) { return true; });
  for (float u : at_once.displacement.samples) ASSERT_EQ(u, 0);
  EXPECT_EQ(at_once.warped.samples, input.moving.samples);
  EXPECT_TRUE(at_once.summary.history.empty());

  const RegistrationResult<2> coarse = stopped_run(input, [](const Progress& now) { return now.iteration == 3; });
  EXPECT_EQ(coarse.summary.history.size(), 3u);
  EXPECT_EQ(coarse.summary.levels.size(), 1u);
  EXPECT_LT(coarse.summary.similarity_after, coarse.summary.similarity_before);

  // In the middle of an evaluation of the finest level: what was accepted until then stays.
  int calls = 0;
  const RegistrationResult<2> fine =
      stopped_run(input, [&](const Progress& now) { return now.level == 2 && now.iteration == 4 && ++calls > 3; });
  EXPECT_EQ(fine.summary.levels.size(), 2u);
  EXPECT_EQ(fine.summary.history.back().iteration, 4);
  EXPECT_LT(fine.summary.similarity_after, coarse.summary.similarity_after);
}

// Wherever a run is stopped, in a look between two rounds as well, its levels say what was accepted.
TEST(RegisterImages, CountsEveryStepOnceWhereverItStops) {
  const RegistrationInput<2> input = sliding_pair<2>(plane(), 2.0);
  for (Model model : {Model::Sliding, Model::Auto}) {
    RegistrationOptions options = quick(model, SimilarityType::Lncc, 3);
    int calls = 0;
    register_images<2>(input, options, [&](const Progress&) { return ++calls, ProgressAnswer::Continue; });
    ASSERT_GT(calls, 20);
    for (int most = 1; most < calls; ++most) {
      int left = most;
      const RegistrationSummary found = register_images<2>(input, options, [&](const Progress&) {
                                          return --left > 0 ? ProgressAnswer::Continue : ProgressAnswer::Stop;
                                        }).summary;
      int counted = 0;
      for (const LevelSummary& level : found.levels) counted += level.iterations;
      ASSERT_EQ(counted, static_cast<int>(found.history.size())) << to_string(model) << " stopped at call " << most;
    }
  }
}

TEST(RegisterImages, NeverLetsTheEnergyRiseWithinARound) {
  for (Model model : all_models())
    for (SimilarityType similarity : all_similarities()) {
      SCOPED_TRACE(to_string(model) + " " + to_string(similarity));
      RegistrationOptions options = quick(model, similarity, 12);
      options.momenta.sparsity = 1e-4;
      options.momenta.sparsity_path = options.momenta.reweighted_rounds = 2;
      options.momenta.debias = true;
      if (model == Model::Auto) options.momenta.first_order_shear = 1e-9;
      if (model == Model::Directional) options.momenta.direction = {1, 0};
      const int rounds = options.momenta.first_order_scales > 0 ? (options.momenta.first_order_waits ? 6 : 5) : 1;
      const RegistrationSummary summary = register_images<2>(sliding_pair<2>(plane(), 2.0), options).summary;
      ASSERT_EQ(summary.levels.size(), 2u);
      // With ssd they were let in on the coarser level, after one round more. What that found needs no path.
      const bool has_found = summary.levels.front().active_block_share > 0;
      EXPECT_EQ(summary.levels.back().rounds, rounds - (has_found ? options.momenta.sparsity_path : 0));
      if (model == Model::Wendland1 || model == Model::Directional) {
        EXPECT_TRUE(has_found);
      }
      if (model == Model::Auto && !options.momenta.first_order_waits) {
        EXPECT_EQ(summary.levels.front().rounds, rounds + 1);
      }
      int iterations = 0;
      for (const LevelSummary& level : summary.levels) {
        double last = level.energy_before;
        int round = 1;
        for (const IterationRecord& record : summary.history) {
          if (record.level != level.level) continue;
          if (record.round == round) {
            EXPECT_LE(record.energy, last);
          }
          round = record.round;
          EXPECT_NEAR(record.energy, record.similarity + record.regularisation + record.sparsity,
                      1e-9 * std::abs(record.energy));
          last = record.energy;
          ++iterations;
        }
        EXPECT_EQ(last, level.energy_after);
      }
      EXPECT_EQ(iterations, static_cast<int>(summary.history.size()));
      EXPECT_LT(summary.similarity_after, summary.similarity_before - 0.15 * std::abs(summary.similarity_before));
    }
}

template <int Dim>
void expect_no_motion(const ImageGrid<Dim>& grid, float fixed, float moving, SimilarityType similarity) {
  RegistrationInput<Dim> input;
  input.fixed = Volume<Dim>(grid, fixed);
  input.moving = Volume<Dim>(grid, moving);
  const RegistrationResult<Dim> result = register_images<Dim>(input, quick(Model::Sliding, similarity));
  for (float u : result.displacement.samples) ASSERT_EQ(u, 0);
  for (float u : result.inverse_displacement.samples) ASSERT_EQ(u, 0);
  for (float j : result.jacobian.samples) ASSERT_NEAR(j, 1, 1e-6f);
  EXPECT_EQ(result.summary.termination, Termination::NothingToRegister);
  EXPECT_EQ(result.summary.share_jacobian_not_positive, 0);
  EXPECT_EQ(result.summary.notices.size(), 2u);
}

TEST(RegisterImages, MovesNothingBetweenConstantImages) {
  for (SimilarityType similarity : all_similarities()) {
    expect_no_motion<2>(plane(), 7, 7, similarity);
    expect_no_motion<2>(plane(), 0, -1000, similarity);
    expect_no_motion<3>(block(), 1e-6f, 3e4f, similarity);
  }
}

// The energy would have the moving image pushed out of sight until only its border's value is left.
TEST(RegisterImages, MovesNothingWhenOneImageIsConstantAndSaysSo) {
  RegistrationInput<2> input = sliding_pair<2>(plane(), 2.0);
  std::fill(input.fixed.samples.begin(), input.fixed.samples.end(), 3.5f);
  const RegistrationResult<2> result = register_images<2>(input, quick(Model::Sliding, SimilarityType::Ssd));
  for (float u : result.displacement.samples) ASSERT_EQ(u, 0);
  EXPECT_EQ(result.warped.samples, input.moving.samples);
  EXPECT_EQ(result.summary.termination, Termination::NothingToRegister);
  ASSERT_EQ(result.summary.notices.size(), 1u);
  EXPECT_EQ(result.summary.notices.front(),
            "fixed image is 3.5 everywhere; nothing in it shows where anything belongs, so nothing was moved");

  // What counts is what the mask shows.
  input = sliding_pair<2>(plane(), 2.0);
  input.moving_mask = Volume<2>(plane(), 0.0f);
  for (std::size_t i = 0; i < 5; ++i) input.moving_mask->samples[i] = 1, input.moving.samples[i] = 2;
  const RegistrationResult<2> masked = register_images<2>(input, quick(Model::Sliding, SimilarityType::Ssd));
  ASSERT_EQ(masked.summary.notices.size(), 1u);
  EXPECT_EQ(masked.summary.notices.front().find("moving image is 2 everywhere in its mask; "), 0u);
  EXPECT_TRUE(register_images<2>(sliding_pair<2>(plane(), 2.0), quick(Model::Sliding, SimilarityType::Ssd, 1))
                  .summary.notices.empty());
}

TEST(RegisterImages, MovesNothingBetweenEqualImages) {
  RegistrationInput<2> input = sliding_pair<2>(plane(), 2.0);
  input.moving = input.fixed;
  const RegistrationResult<2> result = register_images<2>(input, quick(Model::Sliding, SimilarityType::Ssd));
  for (float u : result.displacement.samples) ASSERT_EQ(u, 0);
  EXPECT_EQ(result.warped.samples, input.moving.samples);
}

// The convention: fixed(x) ~ moving(x + u(x)). A translation is seen where there is something to see.
TEST(RegisterImages, GivesTheDisplacementFromFixedToMoving) {
  const AnalyticScene<2> scene(14, 2.5, 80, 5);
  const Vector<2> shift(2.2, -1.3);
  RegistrationInput<2> input;
  input.moving = sampled<2>(plane(), scene);
  input.fixed = sampled<2>(plane(), [&](const Vector<2>& x) { return scene(x + shift); });
  for (SimilarityType similarity : {SimilarityType::Ssd, SimilarityType::Lncc})
    for (Model model : {Model::Gaussian, Model::Sliding}) {
      SCOPED_TRACE(to_string(model) + " " + to_string(similarity));
      RegistrationOptions options = quick(model, similarity, 40);
      options.momenta.scales = 3;
      options.momenta.regularisation = similarity == SimilarityType::Ssd ? 2e-5 : 5e-4;
      options.momenta.sparsity = 1e-3;
      options.optimisation.tolerance = 1e-5;
      const RegistrationResult<2> result = register_images<2>(input, options);
      double forward = 0, backward = 0, intensity = 0;
      int count = 0;
      for_voxels<2>(plane(), [&](const Vector<2>& x, std::size_t voxel) {
        if (x.norm() > 9) return;  // farther out there is little to see
        ++count;
        forward += (vector_at(result.displacement, x) - shift).norm();
        backward += (vector_at(result.inverse_displacement, x) + shift).norm();
        intensity += std::abs(result.warped.samples[voxel] - input.fixed.samples[voxel]);
      });
      // The other sign, or the other direction, would be 5 mm off.
      EXPECT_LT(forward / count, 0.4);
      EXPECT_LT(backward / count, 0.4);
      EXPECT_LT(intensity / count, 0.12);
      EXPECT_LT(result.summary.inverse_consistency_mm, 0.05);
    }
}

// A slip along an axis is what order 1 is for: rows beside the interface move apart.
// Of the geodesic of one kernel alone.
TEST(RegisterImages, TellsTheDriftOfTheHamiltonianWhereThatIsAnInvariant) {
  const RegistrationInput<2> input = sliding_pair<2>(plane(), 1.0);
  RegistrationOptions options = quick(Model::Gaussian, SimilarityType::Ssd, 3);
  options.momenta.scales = 1;
  for (Evolution evolution : {Evolution::Carried, Evolution::PerOrder, Evolution::Exact}) {
    options.flow.evolution = evolution;
    const double drift = register_images<2>(input, options).summary.hamiltonian_drift;
    EXPECT_EQ(drift >= 0, evolution == Evolution::Exact) << static_cast<int>(evolution);
  }
  options.momenta.scales = 2;
  EXPECT_EQ(register_images<2>(input, options).summary.hamiltonian_drift, -1);
}

TEST(RegisterImages, RecoversASlip) {
  const RegistrationInput<2> input = sliding_pair<2>(plane(), 2.0);
  RegistrationOptions options = quick(Model::Sliding, SimilarityType::Ssd, 80);
  options.momenta.regularisation = options.momenta.first_order_regularisation = 2e-5;
  options.momenta.sparsity = 1e-3;
  options.optimisation.tolerance = 1e-5;
  const RegistrationResult<2> result = register_images<2>(input, options);
  double jump = 0;
  for (double y = -8; y <= 8; y += 1)
    jump += vector_at(result.displacement, {1.5, y})[1] - vector_at(result.displacement, {-1.5, y})[1];
  EXPECT_NEAR(jump / 17, 4, 0.6);
}

// What a mask hides may hold anything, on every level.
TEST(RegisterImages, IgnoresWhatTheMasksHide) {
  RegistrationInput<2> input = sliding_pair<2>(plane(), 1.0);
  input.fixed_mask.emplace(plane(), 1.0f);
  input.moving_mask = input.fixed_mask;
  const std::size_t hidden = input.fixed.samples.size() / 4;
  std::fill_n(input.fixed_mask->samples.begin(), hidden, 0.0f);
  std::fill_n(input.moving_mask->samples.rbegin(), hidden, 0.0f);
  for (SimilarityType similarity : all_similarities()) {
    RegistrationOptions options = quick(Model::Sliding, similarity);
    options.pyramid.levels = 3;
    RegistrationInput<2> changed = input;
    std::fill_n(changed.fixed.samples.begin(), hidden, 1000.0f);
    std::fill_n(changed.moving.samples.rbegin(), hidden, -500.0f);
    const RegistrationResult<2> one = register_images<2>(input, options), other = register_images<2>(changed, options);
    EXPECT_EQ(one.displacement.samples, other.displacement.samples);
    EXPECT_EQ(one.summary.similarity_after, other.summary.similarity_after);
  }
}

}  // namespace
}  // namespace saltus
