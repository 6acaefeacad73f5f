// Oracle: LinearCell, one point at a time.
#include "core/grid/cell_lanes.h"

#include "tests/unit/core/grid/points_around.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <vector>

namespace saltus {
namespace {

using testing::points_around;
using testing::random_in;

template <int Dim, class T>
void expect_the_same(const Lattice<Dim>& lattice) {
  const T close = 8 * std::numeric_limits<T>::epsilon();
  const std::vector<T> field = random_in<T>(lattice.sites(), 7);
  const LanePoints<Dim, T> at = points_around<Dim, T>(lattice, 3);
  CellLanes<Dim, T> cells(lattice);
  cells.find(at);
  LanePoints<Dim, T> gradient;
  const auto values = cells.value(field.data()), again = cells.value(field.data(), &gradient);
  for (int lane = 0; lane < cells.kLanes; ++lane) {
    std::array<T, Dim> point;
    for (int axis = 0; axis < Dim; ++axis) point[axis] = at[axis][lane];
    const LinearCell<Dim, T> expected(lattice, point), found = cells.cell(lane);
    EXPECT_EQ(found.base, expected.base) << lane;
    EXPECT_EQ(found.low, expected.low) << lane;
    EXPECT_EQ(found.step, expected.step) << lane;
    EXPECT_EQ(found.slope, expected.slope) << lane;
    EXPECT_EQ(cells.plane(lane), expected.low[Dim - 1]) << lane;
    const T value = expected.template value<1>(field.data())[0];
    if (lane == 5) {  // seen, not hidden
      EXPECT_TRUE(std::isnan(value) && std::isnan(values[lane]) && std::isnan(again[lane]));
      continue;
    }
    EXPECT_EQ(found.fraction, expected.fraction) << lane;
    EXPECT_NEAR(values[lane], value, close) << lane;
    EXPECT_NEAR(again[lane], values[lane], close) << lane;
    const auto slopes = expected.template pulled_back_gradient<1>(field.data(), {T(1)});
    for (int axis = 0; axis < Dim; ++axis) EXPECT_NEAR(gradient[axis][lane], slopes[axis], close) << lane;
  }
}
template <class T>
void expect_the_same_on_all() {
  expect_the_same<2, T>({{9, 7}, {1, 1}, {}});
  expect_the_same<3, T>({{6, 5, 7}, {1, 1, 1}, {}});
  // Axes of one sample.
  expect_the_same<2, T>({{1, 7}, {1, 1}, {}});
  expect_the_same<2, T>({{9, 1}, {1, 1}, {}});
  expect_the_same<3, T>({{6, 1, 7}, {1, 1, 1}, {}});
  expect_the_same<3, T>({{1, 1, 1}, {1, 1, 1}, {}});
}

TEST(CellLanes, AreLinearCellsSideBySide) { expect_the_same_on_all<double>(); }
TEST(CellLanes, InSinglePrecisionAreLinearCellsSideBySide) { expect_the_same_on_all<float>(); }

TEST(CellLanes, OnASampleGiveItsValueToTheLastBit) {
  const auto expect_equal = [](auto zero) {
    using T = decltype(zero);
    const Lattice<2> lattice{{5, 4}, {1, 1}, {}};
    const std::vector<T> field = random_in<T>(lattice.sites(), 1);
    LanePoints<2, T> at{};
    for (int lane = 0; lane < 16; ++lane) at[0][lane] = T(lane % 5), at[1][lane] = T(lane / 5);
    CellLanes<2, T> cells(lattice);
    cells.find(at);
    const auto values = cells.value(field.data());
    for (std::size_t lane = 0; lane < 16; ++lane) EXPECT_EQ(values[lane], field[lane]) << lane;
  };
  expect_equal(0.0);
  expect_equal(0.0f);
}

}  // namespace
}  // namespace saltus
