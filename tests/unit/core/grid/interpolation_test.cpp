#include "core/grid/interpolation.h"

#include <gtest/gtest.h>

#include <limits>

#include "tests/support/random_fields.h"

namespace saltus {
namespace {

using testing::random_values;

const Lattice<3> kLattice{{5, 4, 3}, {1.0, 1.2, 2.5}, {0.4, -1, 3}};

// Oracle: a function that is linear along each axis is its own interpolant.
TEST(LinearCell, ReproducesMultilinearFunctions) {
  const auto f = [](double x, double y, double z) {
    return 1 + 2 * x - y + 0.5 * z + 0.3 * x * y - 0.7 * y * z + 0.2 * x * y * z;
  };
  std::vector<double> field(2 * kLattice.sites());
  for (int slab = 0; slab < 3; ++slab)
    visit_slab<3>(kLattice, slab, [&](const Index<3>& i, std::size_t site) {
      field[2 * site] = f(i[0], i[1], i[2]);
      field[2 * site + 1] = -3 * field[2 * site];
    });
  testing::Random random(4);
  for (int k = 0; k < 200; ++k) {
    const std::array<double, 3> at = {2 + 1.99 * random.symmetric(), 1.5 + 1.49 * random.symmetric(),
                                      1 + 0.99 * random.symmetric()};
    const auto value = LinearCell<3, double>(kLattice, at).value<2>(field.data());
    EXPECT_NEAR(value[0], f(at[0], at[1], at[2]), 1e-12);
    EXPECT_NEAR(value[1], -3 * f(at[0], at[1], at[2]), 1e-12);
  }
}

TEST(LinearCell, TakesTheNearestBorderValueOutsideWithoutSlopeAcross) {
  const std::vector<double> field = random_values(kLattice.sites(), 2);
  for (const std::array<double, 3>& out : {std::array{-7.0, 1.3, 0.6},
                                           {9.5, 1.3, 0.6},
                                           {2.2, -1e6, 0.6},
                                           {2.2, 1e30, 0.6},
                                           {2.2, 1.3, 2.0},
                                           {2.2, 1.3, -0.001},
                                           {-3.0, 44.0, 5.0}}) {
    std::array<double, 3> clamped;
    for (int axis = 0; axis < 3; ++axis) clamped[axis] = std::clamp(out[axis], 0.0, double(kLattice.size[axis] - 1));
    const LinearCell<3, double> cell(kLattice, out), inside(kLattice, clamped);
    EXPECT_EQ(cell.value<1>(field.data())[0], inside.value<1>(field.data())[0]);
    const auto gradient = cell.pulled_back_gradient<1>(field.data(), {1.0});
    for (int axis = 0; axis < 3; ++axis)
      if (out[axis] != clamped[axis]) {
        EXPECT_EQ(gradient[axis], 0) << axis;
      }
  }
}

// Oracle: central differences within a cell, where the interpolant is smooth.
TEST(LinearCell, HasTheGradientOfItsValue) {
  const std::vector<double> field = random_values(3 * kLattice.sites(), 3);
  const std::array<double, 3> dual = {0.3, -1.1, 0.7};
  const auto pairing = [&](std::array<double, 3> at) {
    const auto value = LinearCell<3, double>(kLattice, at).value<3>(field.data());
    return dual[0] * value[0] + dual[1] * value[1] + dual[2] * value[2];
  };
  for (const std::array<double, 3>& at :
       {std::array{0.2, 0.7, 0.5}, {3.9, 2.1, 1.01}, {1.5, 1.5, -2.0}, {-1.0, 2.5, 1.5}}) {
    const auto gradient = LinearCell<3, double>(kLattice, at).pulled_back_gradient<3>(field.data(), dual);
    for (int axis = 0; axis < 3; ++axis) {
      auto up = at, down = at;
      up[axis] += 1e-4, down[axis] -= 1e-4;
      EXPECT_NEAR(gradient[axis], (pairing(up) - pairing(down)) / 2e-4, 1e-9);
    }
  }
}

// Oracle: one component at a time. In 3-D three components are taken in another way than one.
TEST(LinearCell, GivesValueAndSlopesOfAllComponents) {
  for (const Index<3>& size : {Index<3>{5, 4, 3}, {5, 1, 3}, {5, 4, 1}, {1, 4, 3}}) {
    Lattice<3> lattice = kLattice;
    lattice.size = size;
    const std::vector<double> field = random_values(3 * lattice.sites(), 6);
    for (const std::array<double, 3>& at :
         {std::array{0.2, 0.7, 0.5}, {3.9, 2.1, 1.01}, {1.5, 1.5, -2.0}, {-1.0, 2.5, 1.5}, {2.0, 9.0, 2.0}}) {
      const LinearCell<3, double> cell(lattice, at);
      std::array<std::array<double, 3>, 3> slopes;
      const auto value = cell.value_and_slopes<3>(field.data(), slopes);
      for (int c = 0; c < 3; ++c) {
        std::vector<double> component;
        for (std::size_t site = 0; site < lattice.sites(); ++site) component.push_back(field[3 * site + c]);
        EXPECT_NEAR(value[c], cell.value<1>(component.data())[0], 1e-14);
        const auto gradient = cell.pulled_back_gradient<1>(component.data(), {1.0});
        for (int axis = 0; axis < 3; ++axis) EXPECT_NEAR(slopes[c][axis], gradient[axis], 1e-14) << c << axis;
      }
    }
  }
}

TEST(LinearCell, ReadsAnAxisOfOneSample) {
  const Lattice<2> line{{3, 1}, {1, 1}, {}};
  const std::vector<double> field = {1, 2, 4};
  for (double y : {-1.0, 0.0, 0.5, 7.0}) {
    const LinearCell<2, double> cell(line, {1.5, y});
    EXPECT_DOUBLE_EQ(cell.value<1>(field.data())[0], 3);
    EXPECT_EQ(cell.pulled_back_gradient<1>(field.data(), {1.0})[1], 0);
  }
}

// A coordinate that is not a number must stay visible and must not read out of bounds.
TEST(LinearCell, PassesOnNaN) {
  const std::vector<float> field(kLattice.sites(), 1.0f);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_TRUE(std::isnan((LinearCell<3, float>(kLattice, {1.0f, nan, 0.5f}).value<1>(field.data())[0])));
}

TEST(Displaced, FindsSitesOfAnotherLatticeInMillimetres) {
  const Lattice<2> from{{4, 4}, {2.0, 3.0}, {1.0, -1.0}}, to{{9, 9}, {0.5, 1.5}, {0.5, 0.5}};
  const double mm[2] = {0.25, -0.75};
  const auto at = SitePlacement<2, double>(from, to)({2, 3}, mm);
  EXPECT_DOUBLE_EQ(at[0], (2 * 2.0 + 1.0 + 0.25 - 0.5) / 0.5);
  EXPECT_DOUBLE_EQ(at[1], (3 * 3.0 - 1.0 - 0.75 - 0.5) / 1.5);
}

}  // namespace
}  // namespace saltus
