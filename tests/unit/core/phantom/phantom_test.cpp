#include <gtest/gtest.h>
#include <omp.h>

#include <algorithm>
#include <cmath>

#include "tests/support/many_threads.h"

#include "core/phantom/make_phantom.h"
#include "core/phantom/scene.h"
#include "core/support/errors.h"
#include "tests/unit/core/phantom/scene_cases.h"

namespace saltus {
namespace {

double sum(const std::vector<float>& samples) {
  double total = 0;
  for (float sample : samples) total += sample;
  return total;
}

template <int Dim>
Vector<Dim> centre_of(const ImageGrid<Dim>& grid, std::size_t voxel) {
  Vector<Dim> index;
  for (int axis = 0; axis < Dim; ++axis) {
    index[axis] = static_cast<double>(voxel % grid.size[axis]);
    voxel /= grid.size[axis];
  }
  return grid.to_world(index);
}

// The arrays hold what the scene's closed forms say, at every voxel.
template <int Dim>
void expect_arrays_are_the_scene() {
  for (const auto& [name, options] : scene_cases<Dim>()) {
    SCOPED_TRACE(name);
    const auto scene = make_scene<Dim>(options);
    const Phantom<Dim> phantom = make_phantom<Dim>(options);
    const ImageGrid<Dim>& grid = phantom.fixed.grid;
    const double near_mm = 3 * grid.spacing.minCoeff();
    for (std::size_t voxel = 0; voxel < grid.voxels(); voxel += 13) {
      const Vector<Dim> x = centre_of(grid, voxel);
      Vector<Dim> u, w;
      for (int axis = 0; axis < Dim; ++axis) {
        u[axis] = phantom.displacement.component(axis)[voxel];
        w[axis] = phantom.inverse_displacement.component(axis)[voxel];
      }
      EXPECT_LT((x + u - scene->to_moving(x)).norm(), 1e-5);
      EXPECT_LT((x + w - scene->to_fixed(x)).norm(), 1e-5);
      EXPECT_NEAR(phantom.fixed.samples[voxel], scene->fixed(x), 1e-3);
      EXPECT_NEAR(phantom.moving.samples[voxel], scene->moving(x), 1e-3);
      const double distance = scene->interface_distance(x);
      EXPECT_EQ(phantom.masks.inside.samples[voxel], distance < 0 ? 1 : 0);
      EXPECT_EQ(phantom.masks.near.samples[voxel], std::abs(distance) <= near_mm ? 1 : 0);
      EXPECT_EQ(phantom.masks.inside.samples[voxel] + phantom.masks.outside.samples[voxel], 1);
    }
    EXPECT_GT(sum(phantom.masks.valid.samples), 0.25 * grid.voxels());
  }
}

TEST(Phantom, ArraysAreTheScene2D) { expect_arrays_are_the_scene<2>(); }
TEST(Phantom, ArraysAreTheScene3D) { expect_arrays_are_the_scene<3>(); }

TEST(Phantom, MasksOfTheRectangleAreThePapers) {
  const Phantom<2> phantom = make_phantom<2>(default_phantom_options(PhantomKind::Rectangle));
  EXPECT_EQ(sum(phantom.masks.inside.samples), 40 * 80);
  EXPECT_EQ(sum(phantom.masks.near.samples), 6 * 80);    // rows 37 to 42
  EXPECT_EQ(sum(phantom.masks.valid.samples), 52 * 80);  // columns 14 to 65
}

template <int Dim>
void expect_landmarks_follow_the_truth() {
  for (const auto& [name, options] : scene_cases<Dim>()) {
    SCOPED_TRACE(name);
    const auto scene = make_scene<Dim>(options);
    const Phantom<Dim> phantom = make_phantom<Dim>(options);
    ASSERT_EQ(phantom.fixed_points.size(), phantom.moving_points.size());
    EXPECT_GE(phantom.fixed_points.size(), 150u);
    int near = 0;
    for (std::size_t i = 0; i < phantom.fixed_points.size(); ++i) {
      EXPECT_LT((scene->to_moving(phantom.fixed_points[i]) - phantom.moving_points[i]).norm(), 1e-9);
      near += std::abs(scene->interface_distance(phantom.fixed_points[i])) <= 3;
    }
    if (options.kind != PhantomKind::Smooth) {
      EXPECT_GE(near, 20);
    }
  }
}

TEST(Phantom, LandmarksFollowTheTruth2D) { expect_landmarks_follow_the_truth<2>(); }
TEST(Phantom, LandmarksFollowTheTruth3D) { expect_landmarks_follow_the_truth<3>(); }

TEST(Phantom, NoiseHasTheAskedSizeAndDiffersBetweenTheImages) {
  PhantomOptions options = default_phantom_options(PhantomKind::Slip);
  options.noise = 0;
  const Phantom<2> clean = make_phantom<2>(options);
  options.noise = 0.05;
  const Phantom<2> noisy = make_phantom<2>(options);
  const auto [low, high] = std::minmax_element(clean.moving.samples.begin(), clean.moving.samples.end());
  EXPECT_NEAR(noisy.noise_sd, 0.05 * (*high - *low), 1e-6);
  double ff = 0, mm = 0, fm = 0, mean = 0;
  const std::size_t count = clean.fixed.samples.size();
  for (std::size_t i = 0; i < count; ++i) {
    const double f = noisy.fixed.samples[i] - clean.fixed.samples[i];
    const double m = noisy.moving.samples[i] - clean.moving.samples[i];
    mean += f / count;
    ff += f * f / count;
    mm += m * m / count;
    fm += f * m / count;
  }
  // 16384 draws: the sd of an sd estimate is 0.55 %, of a correlation 0.8 %; five of each are allowed.
  EXPECT_NEAR(std::sqrt(ff) / noisy.noise_sd, 1, 0.03);
  EXPECT_NEAR(std::sqrt(mm) / noisy.noise_sd, 1, 0.03);
  EXPECT_NEAR(fm / std::sqrt(ff * mm), 0, 0.04);
  EXPECT_NEAR(mean / noisy.noise_sd, 0, 0.04);
  // The truth does not depend on the noise.
  EXPECT_EQ(clean.displacement.samples, noisy.displacement.samples);
}

template <int Dim>
void expect_equal(const Phantom<Dim>& a, const Phantom<Dim>& b) {
  EXPECT_EQ(a.fixed.samples, b.fixed.samples);
  EXPECT_EQ(a.moving.samples, b.moving.samples);
  EXPECT_EQ(a.displacement.samples, b.displacement.samples);
  EXPECT_EQ(a.moving_points, b.moving_points);
}

TEST(Phantom, DependsOnTheSeedAndOnNothingElse) {
  PhantomOptions slip = default_phantom_options(PhantomKind::Slip);
  PhantomOptions thorax = default_phantom_options(PhantomKind::Thorax);
  thorax.size = {48, 40, 40};
  thorax.spacing = {6, 6, 6};
  const testing::ManyThreads many;
  omp_set_num_threads(1);
  const Phantom<2> slip_one = make_phantom<2>(slip);
  const Phantom<3> thorax_one = make_phantom<3>(thorax);
  omp_set_num_threads(4);
  expect_equal(slip_one, make_phantom<2>(slip));
  expect_equal(thorax_one, make_phantom<3>(thorax));
  slip.seed = thorax.seed = 2;
  EXPECT_NE(slip_one.fixed.samples, make_phantom<2>(slip).fixed.samples);
  EXPECT_NE(thorax_one.moving_points, make_phantom<3>(thorax).moving_points);
}

TEST(Phantom, RefusesOptionsThatCannotBeUsed) {
  PhantomOptions options = default_phantom_options(PhantomKind::Slip);
  options.spacing[1] = -1;
  EXPECT_THROW(make_phantom<2>(options), InvalidInput);
}

}  // namespace
}  // namespace saltus
