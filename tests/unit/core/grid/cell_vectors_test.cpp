// What CellLanes does with fields of vectors. Oracle: LinearCell, one point at a time.
#include "core/grid/cell_lanes.h"
#include "core/grid/field_lanes.h"

#include "tests/unit/core/grid/points_around.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

namespace saltus {
namespace {

using testing::points_around;
using testing::random_in;

/// How far apart two vectors are; 0 where neither is a number.
template <int Dim, class T, class Vector>
T distance(const Vector& found, const std::array<T, Dim>& expected) {
  T most = 0;
  for (int c = 0; c < Dim; ++c)
    if (!(std::isnan(found[c]) && std::isnan(expected[c]))) most = std::max(most, std::abs(found[c] - expected[c]));
  return most;
}

template <int Dim, class T>
void expect_the_same_vectors(const Lattice<Dim>& lattice, int count) {
  const T close = 32 * std::numeric_limits<T>::epsilon();
  const std::vector<T> field = random_in<T>(Dim * lattice.sites(), 7);
  const LanePoints<Dim, T> at = points_around<Dim, T>(lattice, 3);
  CellLanes<Dim, T> cells(lattice);
  cells.find(at);
  const std::vector<T> duals = random_in<T>(Dim * 16, 8);
  const LaneVectors<T> dual = vectors_of<Dim, T>(duals.data(), count);
  const auto dual_of = [&](int lane) {
    std::array<T, Dim> of_lane;
    std::copy_n(duals.begin() + Dim * lane, Dim, of_lane.begin());
    return of_lane;
  };
  int visits = 0;
  cells.visit_vectors(field.data(), count, [&](int lane, const auto& value) {
    ++visits;
    EXPECT_LT((distance<Dim, T>(value, cells.cell(lane).template value<Dim>(field.data()))), close) << lane;
  });
  EXPECT_EQ(visits, count);
  cells.visit_gradients(field.data(), dual, count, [&](int lane, const auto& value, const auto& gradient) {
    ++visits;
    EXPECT_LT((distance<Dim, T>(value, cells.cell(lane).template value<Dim>(field.data()))), close) << lane;
    const auto expected = cells.cell(lane).template pulled_back_gradient<Dim>(field.data(), dual_of(lane));
    EXPECT_LT((distance<Dim, T>(gradient, expected)), close) << lane;
  });
  EXPECT_EQ(visits, 2 * count);
  // All lanes, some of them, some planes; no other site is touched (lane 5 apart, which would make all corners NaN).
  LaneMask all, some;
  for (int lane = 0; lane < 16; ++lane) all[lane] = 1, some[lane] = lane % 3 != 0;
  all[5] = some[5] = count <= 5;
  const int planes = lattice.size[Dim - 1];
  for (const LaneMask& wanted : {all, some})
    for (const auto& [begin, end] : {std::pair{0, planes}, std::pair{1, planes - 1}}) {
      std::vector<T> found = field, expected = field;
      cells.spread(dual, count, wanted, begin, end, found.data());
      for (int lane = 0; lane < count; ++lane)
        if (wanted[lane]) cells.cell(lane).template spread<Dim>(dual_of(lane), begin, end, expected.data());
      for (std::size_t i = 0; i < field.size(); ++i) EXPECT_NEAR(found[i], expected[i], close) << i;
    }
}

// Oracle: LinearCell. With all lanes, with fewer, and without the lane whose point is nowhere, so that all are wanted.
TEST(CellLanes, SampleAndSpreadVectorsAsLinearCellsDo) {
  for (const int count : {16, 11, 5, 1}) {
    SCOPED_TRACE(count);
    expect_the_same_vectors<2, double>({{9, 7}, {1, 1}, {}}, count);
    expect_the_same_vectors<2, float>({{1, 7}, {1, 1}, {}}, count);
    for (const Lattice<3>& lattice : {Lattice<3>{{6, 5, 7}, {1, 1, 1}, {}}, Lattice<3>{{6, 1, 7}, {1, 1, 1}, {}},
                                      Lattice<3>{{6, 5, 1}, {1, 1, 1}, {}}, Lattice<3>{{1, 5, 7}, {1, 1, 1}, {}},
                                      Lattice<3>{{1, 1, 1}, {1, 1, 1}, {}}}) {
      expect_the_same_vectors<3, double>(lattice, count);
      expect_the_same_vectors<3, float>(lattice, count);
    }
  }
}

// Oracle: the samples themselves, the last ones along each axis as well.
template <class T>
void expect_the_samples() {
  const Lattice<3> lattice{{4, 2, 2}, {1, 1, 1}, {}};
  const std::vector<T> field = random_in<T>(3 * lattice.sites(), 1);
  LanePoints<3, T> at{};
  for (int lane = 0; lane < 16; ++lane)
    at[0][lane] = static_cast<T>(lane % 4), at[1][lane] = static_cast<T>(lane / 4 % 2),
    at[2][lane] = static_cast<T>(lane / 8);
  CellLanes<3, T> cells(lattice);
  cells.find(at);
  cells.visit_vectors(field.data(), 16, [&](int lane, const auto& value) {
    for (int c = 0; c < 3; ++c) EXPECT_EQ(value[c], field[static_cast<std::size_t>(3 * lane + c)]) << lane;
  });
}

TEST(CellLanes, OnASampleGiveItsVectorToTheLastBit) {
  expect_the_samples<double>();
  expect_the_samples<float>();
}

}  // namespace
}  // namespace saltus
