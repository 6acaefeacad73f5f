#include "core/phantom/thorax_scene.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "core/phantom/make_phantom.h"
#include "core/support/random.h"

namespace saltus {
namespace {

PhantomOptions quiet_thorax() {
  PhantomOptions options = default_phantom_options(PhantomKind::Thorax);
  options.noise = 0;
  return options;
}

TEST(ThoraxScene, LungTissueKeepsItsMassAndEverythingElseItsDensity) {
  const PhantomOptions options = quiet_thorax();
  const ThoraxScene scene(options, phantom_grid<3>(options));
  RandomSequence random(99, 1);
  int lung = 0, tissue = 0, rest = 0;
  double most_compressed = 1;
  for (int draw = 0; draw < 20000; ++draw) {
    const Vector<3> x(random.uniform(-140, 140), random.uniform(-100, 100), random.uniform(-115, 115));
    const double fixed = scene.fixed(x), moving = scene.moving(scene.to_moving(x));
    const int label = scene.fixed_label(x);
    if (label != 1 && label != 2) {
      EXPECT_NEAR(fixed, moving, 1e-9);
      ++rest;
      continue;
    }
    // Where vessel and tissue share a point, only the tissue's share is compressed.
    const double compressed = (moving + 1000) * scene.jacobian(x) - 1000;
    EXPECT_GE(fixed, moving - 1e-9);
    EXPECT_LE(fixed, compressed + 1e-9);
    ++lung;
    tissue += std::abs(fixed - compressed) < 1e-9;
    most_compressed = std::max(most_compressed, scene.jacobian(x));
  }
  EXPECT_GT(lung, 1000);
  EXPECT_GT(tissue, 0.6 * lung);
  EXPECT_GT(rest, 5000);
  EXPECT_GT(most_compressed, 1.2);
}

TEST(ThoraxScene, WallStaysAndTheDiaphragmMovesByTheAskedAmount) {
  const PhantomOptions options = quiet_thorax();
  const ThoraxScene scene(options, phantom_grid<3>(options));
  EXPECT_EQ(scene.to_moving({0, 60, 0}), Vector<3>(0, 60, 0));        // spine
  EXPECT_EQ(scene.to_moving({125, 0, -50}), Vector<3>(125, 0, -50));  // flank
  const Phantom<3> phantom = make_phantom<3>(options);
  EXPECT_NEAR(phantom.largest_displacement_mm, 20, 0.1);
  // Inhale: the diaphragm goes towards the feet.
  EXPECT_LT(scene.to_moving({-67, 0, -60})[2], -60 - 12);
}

TEST(ThoraxScene, HasEnoughLandmarksAndEnoughOfThemNearThePleura) {
  for (double spacing : {3.0, 2.0}) {
    PhantomOptions options = quiet_thorax();
    for (int axis = 0; axis < 3; ++axis) {
      options.size[axis] = static_cast<int>(options.size[axis] * 3 / spacing);
      options.spacing[axis] = spacing;
    }
    const ThoraxScene scene(options, phantom_grid<3>(options));
    const auto points = scene.moving_landmarks();
    EXPECT_GE(points.size(), 300u);
    const auto near = std::count_if(points.begin(), points.end(), [&](const Vector<3>& y) {
      return std::abs(scene.interface_distance(scene.to_fixed(y))) < 5;
    });
    EXPECT_GE(10 * near, static_cast<long>(points.size()));
    for (const Vector<3>& y : points) {
      // A landmark is a place where vessels meet, inside a lung of either image.
      EXPECT_GT(scene.moving(y), -450);
      EXPECT_TRUE(scene.moving_label(y) == 1 || scene.moving_label(y) == 2);
      EXPECT_EQ(scene.fixed_label(scene.to_fixed(y)), scene.moving_label(y));
    }
  }
}

TEST(ThoraxScene, ShowsTheTissuesOfAChest) {
  const Phantom<3> phantom = make_phantom<3>(quiet_thorax());
  auto share = [&](auto wanted) {
    const auto& samples = phantom.moving.samples;
    return static_cast<double>(std::count_if(samples.begin(), samples.end(), wanted)) / samples.size();
  };
  EXPECT_GT(share([](float hu) { return hu == -1000; }), 0.1);
  EXPECT_GT(share([](float hu) { return hu > -950 && hu < -700; }), 0.05);
  EXPECT_GT(share([](float hu) { return hu > -150 && hu < -50; }), 0.03);
  EXPECT_GT(share([](float hu) { return hu > 0 && hu < 200; }), 0.2);
  EXPECT_GT(share([](float hu) { return hu > 300; }), 0.005);
  for (float label : {1, 2, 3, 4, 5})
    EXPECT_GT(std::count(phantom.fixed_labels.samples.begin(), phantom.fixed_labels.samples.end(), label), 1000);
}

}  // namespace
}  // namespace saltus
