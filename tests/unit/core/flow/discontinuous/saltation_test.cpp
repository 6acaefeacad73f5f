#include "core/flow/discontinuous/saltation.h"

#include <gtest/gtest.h>

#include <Eigen/LU>

#include "tests/support/random_fields.h"

namespace saltus {
namespace {

template <int Dim>
Vector<Dim> random_vector(testing::Random& random) {
  Vector<Dim> v;
  for (int c = 0; c < Dim; ++c) v[c] = random.symmetric();
  return v;
}

template <int Dim>
void check_determinant() {
  testing::Random random(7);
  for (int trial = 0; trial < 50; ++trial) {
    SurfaceJet<Dim> surface;
    surface.gradient = 3 * random_vector<Dim>(random);
    surface.rate = random.symmetric();
    const Vector<Dim> before = random_vector<Dim>(random), after = random_vector<Dim>(random);
    if (std::abs(surface.along(before)) < 0.1) continue;
    const double det = saltation(surface, before, after).determinant();
    // Normal flux after over normal flux before, by hand with n and c.
    const Vector<Dim> n = surface.gradient.normalized();
    const double c = -surface.rate / surface.gradient.norm();
    EXPECT_NEAR(det, (n.dot(after) - c) / (n.dot(before) - c), 1e-12 * (1 + std::abs(det) * 100));
    const Vector<Dim> shear = after - n.dot(after - before) * n;
    EXPECT_NEAR(saltation(surface, before, shear).determinant(), 1.0, 1e-11);
  }
}

TEST(Saltation, DeterminantIsTheRatioOfNormalFluxesIn2D) { check_determinant<2>(); }
TEST(Saltation, DeterminantIsTheRatioOfNormalFluxesIn3D) { check_determinant<3>(); }

TEST(Saltation, DoesNotDependOnTheScaleOfH) {
  SurfaceJet<2> distance, scaled;
  distance.gradient = Vector<2>(0.6, 0.8);
  distance.rate = -0.3;
  scaled.gradient = 7 * distance.gradient;
  scaled.rate = 7 * distance.rate;
  const Vector<2> before(1, 0.5), after(0.2, 1.5);
  EXPECT_LT((saltation(distance, before, after) - saltation(scaled, before, after)).norm(), 1e-14);
  const auto paper = [&](const SurfaceJet<2>& jet) {
    return saltation(jet, before, after, SaltationRule::Paper, false);
  };
  EXPECT_LT((paper(distance) - saltation(distance, before, after)).norm(), 1e-14) << "right where H is a distance";
  EXPECT_GT((paper(scaled) - saltation(distance, before, after)).norm(), 0.1) << "as printed, wrong where it is not";
}

TEST(Saltation, PaperSlidingHoldsOnlyForAJumpAlongTheNormal) {
  SurfaceJet<2> surface;
  surface.gradient = Vector<2>(0, 1);
  const auto compare = [&](const Vector<2>& minus, const Vector<2>& plus) {
    const Vector<2> along = sliding_motion<2>(surface, {minus, {}}, {plus, {}}).velocity.value;
    EXPECT_NEAR(along[1], 0, 1e-14);
    const Matrix<2> filippov = saltation(surface, minus, along);
    EXPECT_LT((surface.gradient.transpose() * filippov).norm(), 1e-14) << "what slides stays on the surface";
    return (filippov - saltation(surface, minus, along, SaltationRule::Paper, true)).norm();
  };
  EXPECT_LT(compare({0.4, 1}, {0.4, -2}), 1e-14);
  // v_s = (1/2)(1, 0): the column of the normal is (v_s - v-)/1 = (-0.5, -1), the paper has (0, -1).
  EXPECT_NEAR(compare({1, 1}, {0, -1}), 0.5, 1e-14);
}

}  // namespace
}  // namespace saltus
