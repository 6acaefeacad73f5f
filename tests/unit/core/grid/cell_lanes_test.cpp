// Oracle: LinearCell, one point at a time.
#include "core/grid/cell_lanes.h"

#include "tests/support/random_fields.h"
#include "tests/unit/core/grid/points_around.h"

#include <gtest/gtest.h>

#include <cmath>

namespace saltus {
namespace {

using testing::points_around;
using testing::random_values;

template <int Dim>
void expect_the_same(const Lattice<Dim>& lattice) {
  const std::vector<double> field = random_values(lattice.sites(), 7);
  const LanePoints<Dim, double> at = points_around(lattice, 3);
  CellLanes<Dim, double> cells(lattice);
  cells.find(at);
  LanePoints<Dim, double> gradient;
  const auto values = cells.value(field.data()), again = cells.value(field.data(), &gradient);
  for (int lane = 0; lane < cells.kLanes; ++lane) {
    std::array<double, Dim> point;
    for (int axis = 0; axis < Dim; ++axis) point[axis] = at[axis][lane];
    const LinearCell<Dim, double> expected(lattice, point), found = cells.cell(lane);
    EXPECT_EQ(found.base, expected.base) << lane;
    EXPECT_EQ(found.low, expected.low) << lane;
    EXPECT_EQ(found.step, expected.step) << lane;
    EXPECT_EQ(found.slope, expected.slope) << lane;
    EXPECT_EQ(cells.plane(lane), expected.low[Dim - 1]) << lane;
    const double value = expected.template value<1>(field.data())[0];
    if (lane == 5) {  // seen, not hidden
      EXPECT_TRUE(std::isnan(value) && std::isnan(values[lane]) && std::isnan(again[lane]));
      continue;
    }
    EXPECT_EQ(found.fraction, expected.fraction) << lane;
    EXPECT_NEAR(values[lane], value, 1e-15) << lane;
    EXPECT_EQ(again[lane], values[lane]) << lane;
    const auto slopes = expected.template pulled_back_gradient<1>(field.data(), {1.0});
    for (int axis = 0; axis < Dim; ++axis) EXPECT_NEAR(gradient[axis][lane], slopes[axis], 1e-15) << lane;
  }
}

TEST(CellLanes, AreLinearCellsSideBySide) {
  expect_the_same<2>({{9, 7}, {1, 1}, {}});
  expect_the_same<3>({{6, 5, 7}, {1, 1, 1}, {}});
}

TEST(CellLanes, KnowAxesOfOneSample) {
  expect_the_same<2>({{1, 7}, {1, 1}, {}});
  expect_the_same<2>({{9, 1}, {1, 1}, {}});
  expect_the_same<3>({{6, 1, 7}, {1, 1, 1}, {}});
  expect_the_same<3>({{1, 1, 1}, {1, 1, 1}, {}});
}

TEST(CellLanes, OnASampleGiveItsValueToTheLastBit) {
  const Lattice<2> lattice{{5, 4}, {1, 1}, {}};
  const std::vector<double> field = random_values(lattice.sites(), 1);
  LanePoints<2, double> at{};
  for (int lane = 0; lane < 16; ++lane) at[0][lane] = lane % 5, at[1][lane] = lane / 5;
  CellLanes<2, double> cells(lattice);
  cells.find(at);
  const auto values = cells.value(field.data());
  for (std::size_t lane = 0; lane < 16; ++lane) EXPECT_EQ(values[lane], field[lane]) << lane;
}

}  // namespace
}  // namespace saltus
