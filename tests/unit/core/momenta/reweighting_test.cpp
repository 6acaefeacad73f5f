#include "core/momenta/reweighting.h"

#include <gtest/gtest.h>

#include <cmath>

namespace saltus {
namespace {

/// A 7x5 lattice with (3, 4) in m_0 at site (3, 2) and (0, 1) in m_1 at site (6, 4).
struct Scene {
  Lattice<2> lattice;
  std::vector<double> first;
  Scene() {
    lattice.size = {7, 5};
    lattice.spacing = {1, 1};
    first.assign(4 * lattice.sites(), 0);
    first[2 * (2 * 7 + 3)] = 3;
    first[2 * (2 * 7 + 3) + 1] = 4;
    first[2 * (35 + 34) + 1] = 1;
  }
  std::vector<std::vector<float>> sizes() const { return momentum_sizes<2, double>(lattice, first.data(), 2); }
};

TEST(Reweighting, JudgesAGroupByItsNeighbourhood) {
  const Scene scene;
  const auto factors = reweighted_factors<2>(scene.lattice, scene.sizes());
  ASSERT_EQ(factors.size(), 2u);
  for (int y = 0; y < 5; ++y)
    for (int x = 0; x < 7; ++x) {
      const bool beside_large = std::abs(x - 3) <= 1 && std::abs(y - 2) <= 1, beside_small = x >= 5 && y >= 3;
      EXPECT_NEAR(factors[0][y * 7 + x], beside_large ? 1 / 10.15 : 1 / 0.15, 1e-5);
      EXPECT_NEAR(factors[1][y * 7 + x], beside_small ? 1 / (0.15 + 2) : 1 / 0.15, 1e-5);
    }
}

TEST(Reweighting, RaisesAllWeightsAlikeWhereNothingMoves) {
  const Scene scene;
  const std::vector<double> none(scene.first.size(), 0);
  for (const auto& axis :
       reweighted_factors<2>(scene.lattice, momentum_sizes<2, double>(scene.lattice, none.data(), 2)))
    for (float factor : axis) EXPECT_NEAR(factor, 1 / 0.15, 1e-5);
}

TEST(Reweighting, KeepsTheSupportAndNothingElse) {
  const Scene scene;
  const auto factors = support_factors(scene.sizes());
  for (int axis = 0; axis < 2; ++axis)
    for (std::size_t site = 0; site < 35; ++site) {
      const bool on_support = axis == 0 ? site == 2 * 7 + 3 : site == 34;
      EXPECT_EQ(factors[axis][site] == 0, on_support);
      EXPECT_EQ(std::isinf(factors[axis][site]), !on_support);
    }
}

}  // namespace
}  // namespace saltus
