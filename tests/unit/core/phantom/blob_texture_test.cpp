#include "core/phantom/blob_texture.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/support/random.h"

namespace saltus {
namespace {

// A seam between cells would show as a jump of the value or of the slope.
TEST(BlobTexture, IsSmoothAcrossCells) {
  const BlobTexture<2> texture({{6, 50}, {14, 60}}, 5);
  constexpr double kStep = 0.01;
  for (double x = -30; x < 30; x += kStep) {
    const double before = texture({x - kStep, 3.3}), here = texture({x, 3.3}), after = texture({x + kStep, 3.3});
    // Second differences stay below step^2 times the largest curvature, 8 a / R^2 for each of at most 9 blobs a scale.
    EXPECT_LT(std::abs(after - 2 * here + before), kStep * kStep * 9 * 8 * (50.0 / 36 + 60.0 / 196)) << x;
  }
}

TEST(BlobTexture, FillsSpaceWithZeroMeanAndDoesNotRepeat) {
  const BlobTexture<3> texture({{6, 1}}, 5);
  RandomSequence random(1, 1);
  constexpr int kDraws = 40000;
  double sum = 0, squares = 0, shifted = 0;
  for (int i = 0; i < kDraws; ++i) {
    const Vector<3> p(random.uniform(-300, 300), random.uniform(-300, 300), random.uniform(-300, 300));
    const double value = texture(p);
    sum += value;
    squares += value * value;
    shifted += value * texture(p + Vector<3>(60, 0, 0));
  }
  const double sd = std::sqrt(squares / kDraws);
  EXPECT_GT(sd, 0.05);
  EXPECT_LT(std::abs(sum / kDraws), 0.1 * sd);
  EXPECT_LT(std::abs(shifted / squares), 0.05);
}

TEST(BlobTexture, DiffersBySeed) {
  EXPECT_NE(BlobTexture<2>({{6, 1}}, 1)({3, 4}), BlobTexture<2>({{6, 1}}, 2)({3, 4}));
}

}  // namespace
}  // namespace saltus
