// Oracle: the identity. A point of the moving image goes to the fixed one and back, by the fields as a user has them.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "core/evaluation/field_sampling.h"
#include "core/evaluation/statistics.h"
#include "core/phantom/make_phantom.h"
#include "core/registration/register_images.h"
#include "tests/support/analytic_scene.h"
#include "tests/support/many_threads.h"
#include "tests/support/phantom_pair.h"

namespace saltus {
namespace {

/// Lengths, in voxels, of going from each voxel through `first` and back through `second`, where the way leads to a
/// place farther than 5 voxels from the interface and inside the image.
template <int Dim>
std::vector<double> round_trips(const PhantomOptions& scene_options, const VectorVolume<Dim>& first,
                                const VectorVolume<Dim>& second) {
  const auto scene = make_scene<Dim>(scene_options);
  const ImageGrid<Dim>& grid = second.grid;
  const double voxel = grid.spacing.minCoeff();
  std::vector<double> errors;
  testing::for_voxels<Dim>(first.grid, [&](const Vector<Dim>& y, std::size_t at) {
    Vector<Dim> x = y;
    for (int c = 0; c < Dim; ++c) x[c] += first.component(c)[at];
    const Vector<Dim> index = grid.to_index(x);
    for (int axis = 0; axis < Dim; ++axis)
      if (!(index[axis] >= 0 && index[axis] <= grid.size[axis] - 1)) return;
    if (std::abs(scene->interface_distance(x)) <= 5 * voxel) return;
    errors.push_back((x + displacement_at(second, x) - y).norm() / voxel);
  });
  return errors;
}

template <int Dim>
void expect_consistent(const PhantomOptions& scene, Model model, int time_steps) {
  SCOPED_TRACE(to_string(scene.kind) + " " + to_string(model) + " " + std::to_string(time_steps));
  const Phantom<Dim> phantom = make_phantom<Dim>(scene);
  RegistrationInput<Dim> input = testing::pair_of(phantom);
  RegistrationOptions options = default_options(model, SimilarityType::Ssd, Preset::Balanced);
  options.optimisation.max_iterations = 25;
  options.flow.time_steps = time_steps;
  options.pyramid.finest_level = 0;
  const RegistrationResult<Dim> result = register_images<Dim>(input, options);
  for (const bool from_moving : {true, false}) {
    SCOPED_TRACE(from_moving ? "moving, fixed, moving" : "fixed, moving, fixed");
    std::vector<double> errors = from_moving ? round_trips(scene, result.inverse_displacement, result.displacement)
                                             : round_trips(scene, result.displacement, result.inverse_displacement);
    ASSERT_GT(errors.size(), phantom.fixed.samples.size() / 8);
    std::sort(errors.begin(), errors.end());
    const double mean = summarise(errors).mean, p95 = quantile_of_sorted(errors, 0.95);
    // The inverse leads to where the displacement leads back, to 1e-4 of a voxel; a few places do not exist there. The
    // other way round it is read between its voxels, which costs what linear interpolation of it costs.
    EXPECT_LT(mean, from_moving ? 0.005 : 0.1);
    EXPECT_LT(p95, from_moving ? 0.001 : 0.2);
  }
  std::vector<double> moved;
  for (std::size_t i = 0; i < phantom.fixed.samples.size(); ++i) moved.push_back(result.displacement.samples[i]);
  EXPECT_GT(summarise(moved).sd, 0.2);  // there is a motion to undo
}

TEST(InverseConsistency, OfTheRectangle) {
  for (int steps : {1, 3}) expect_consistent<2>(default_phantom_options(PhantomKind::Rectangle), Model::Sliding, steps);
}

TEST(InverseConsistency, OfTheSlip) {
  PhantomOptions scene = default_phantom_options(PhantomKind::Slip);
  scene.size = {72, 72, 1};
  for (Model model : {Model::Gaussian, Model::Sliding})
    for (int steps : {1, 3}) expect_consistent<2>(scene, model, steps);
}

TEST(InverseConsistency, OfASmallThorax) {
  PhantomOptions scene = default_phantom_options(PhantomKind::Thorax);
  scene.size = {32, 24, 26};
  scene.spacing = {9, 9, 9};
  expect_consistent<3>(scene, Model::Sliding, 3);
}

// More planes than are on their way at the same time.
TEST(InverseConsistency, OfATallThorax) {
  PhantomOptions scene = default_phantom_options(PhantomKind::Thorax);
  scene.size = {24, 20, 72};
  scene.spacing = {12, 11, 4};
  expect_consistent<3>(scene, Model::Gaussian, 3);
}

// Oracle: the same bits. Rows of 35 voxels: two pieces of 16 and a rest.
TEST(InverseConsistency, DoesNotDependOnTheNumberOfThreads) {
  const testing::ManyThreads many;
  PhantomOptions scene = default_phantom_options(PhantomKind::Thorax);
  scene.size = {35, 24, 26};
  scene.spacing = {9, 9, 9};
  const Phantom<3> phantom = make_phantom<3>(scene);
  RegistrationOptions options = default_options(Model::Gaussian, SimilarityType::Ssd, Preset::Fast);
  const auto inverse = [&](int threads) {
    options.threads = threads;
    return register_images<3>(testing::pair_of(phantom), options).inverse_displacement.samples;
  };
  EXPECT_TRUE(inverse(1) == inverse(3));
}

// Oracle: the displacement itself. A row of one voxel, and planes.
TEST(InverseConsistency, OfImagesThatAreThinAlongAnAxis) {
  for (int axis = 0; axis < 3; ++axis) {
    ImageGrid<3> grid;
    grid.size = {20, 20, 20};
    grid.size[axis] = 1;
    Volume<3> fixed(grid), moving(grid);
    std::size_t at = 0;
    for (int z = 0; z < grid.size[2]; ++z)
      for (int y = 0; y < grid.size[1]; ++y)
        for (int x = 0; x < grid.size[0]; ++x, ++at) {
          const double place = 0.4 * (axis == 0 ? y : x) + 0.1 * z;
          fixed.samples[at] = static_cast<float>(std::sin(place));
          moving.samples[at] = static_cast<float>(std::sin(place + 0.3));
        }
    RegistrationInput<3> input;
    input.fixed = fixed;
    input.moving = moving;
    const RegistrationResult<3> result =
        register_images<3>(input, default_options(Model::Gaussian, SimilarityType::Ssd, Preset::Fast));
    EXPECT_LT(result.summary.inverse_consistency_mm, 1e-3) << axis;
    double largest = 0;
    for (float value : result.inverse_displacement.samples) {
      ASSERT_TRUE(std::isfinite(value)) << axis;
      largest = std::max(largest, std::abs(static_cast<double>(value)));
    }
    EXPECT_GT(largest, 0.2) << axis;
  }
}

}  // namespace
}  // namespace saltus
