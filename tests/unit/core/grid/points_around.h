#pragma once

#include "core/grid/cell_lanes.h"

#include "tests/support/random_fields.h"

#include <cmath>
#include <limits>
#include <vector>

namespace saltus::testing {

template <class T>
inline std::vector<T> random_in(std::size_t count, unsigned seed) {
  const std::vector<double> values = random_values(count, seed);
  return {values.begin(), values.end()};
}

/// Points inside, on samples, on both borders, beyond them and nowhere.
template <int Dim, class T>
inline LanePoints<Dim, T> points_around(const Lattice<Dim>& lattice, unsigned seed) {
  LanePoints<Dim, T> at;
  const std::vector<double> values = random_values(Dim * 16, seed, 0.7);
  for (int axis = 0; axis < Dim; ++axis) {
    const double last = lattice.size[axis] - 1;
    for (int lane = 0; lane < 16; ++lane) at[axis][lane] = static_cast<T>(last / 2 + last * values[Dim * lane + axis]);
    at[axis][0] = 0;
    at[axis][1] = static_cast<T>(last);
    at[axis][2] = static_cast<T>(std::floor(last / 2));
    at[axis][3] = T(-2.5);
    at[axis][4] = static_cast<T>(last + 3);
  }
  at[0][5] = std::numeric_limits<T>::quiet_NaN();
  return at;
}

}  // namespace saltus::testing
