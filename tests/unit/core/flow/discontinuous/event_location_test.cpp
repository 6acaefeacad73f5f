#include "core/flow/discontinuous/event_location.h"

#include <gtest/gtest.h>

#include <vector>

namespace saltus {
namespace {

// Oracle: functions with known roots.
TEST(EventLocation, FindsTheFirstOfSeveralRoots) {
  for (double root : {1e-6, 0.013, 0.3, 0.71, 0.999}) {
    const auto f = [&](double s) { return (root - s) * (root + 0.05 - s) * (2.0 - s); };
    const auto found = first_fall(f, 0.0, 1.0, 1e-14);
    ASSERT_TRUE(found.has_value()) << root;
    EXPECT_NEAR(*found, root, 1e-12) << root;
  }
}

TEST(EventLocation, FindsADipBetweenTwoSamples) {
  const double middle = 0.43, half = 0.004;  // both roots between samples 3 and 4
  const auto f = [&](double s) { return (s - middle) * (s - middle) - half * half; };
  const auto found = first_fall(f, 0.0, 1.0, 1e-14);
  ASSERT_TRUE(found.has_value());
  EXPECT_NEAR(*found, middle - half, 1e-10);
}

TEST(EventLocation, IgnoresTheSurfaceItHasJustLeft) {
  EXPECT_FALSE(first_fall([](double s) { return s - 1e-17; }, 0.0, 1.0, 1e-14).has_value());
  // Leaves and comes back within the first eighth.
  const auto found = first_fall([](double s) { return s * (0.05 - s); }, 0.0, 1.0, 1e-14);
  ASSERT_TRUE(found.has_value());
  EXPECT_NEAR(*found, 0.05, 1e-10);
}

TEST(EventLocation, SaysNothingWhereNothingIs) {
  EXPECT_FALSE(first_fall([](double s) { return 0.1 + (s - 0.5) * (s - 0.5); }, 0.0, 1.0, 1e-14).has_value());
}

}  // namespace
}  // namespace saltus
