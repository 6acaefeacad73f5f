#pragma once

#include "core/grid/interpolation.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

namespace saltus {

/// Cells (LinearCell) of neighbouring sites, side by side: where they are, and what a scalar field is there, is worked
/// out in lanes; only the values at the corners are fetched one by one. For loops over rows of sites (visit_pieces).
template <int Dim, class T>
class CellLanes {
 public:
  static constexpr int kLanes = 16;
  static constexpr int kCorners = 1 << Dim;
  using Lanes = std::array<T, kLanes>;
  using Points = std::array<Lanes, Dim>;  ///< by axis

  /// Cells of a lattice of fewer than 2^32 sites.
  explicit CellLanes(const Lattice<Dim>& lattice) {
    std::uint32_t stride = 1;
    for (int axis = 0; axis < Dim; ++axis) {
      last_[axis] = lattice.size[axis] - 1;
      stride_[axis] = stride;
      stride *= static_cast<std::uint32_t>(lattice.size[axis]);
    }
  }

  /// Finds the cells of the points `at`, index coordinates by axis. As in LinearCell points outside are moved to the
  /// border, where the slope is 0, and what is not a number lands in a valid cell and is seen in the fraction.
  [[gnu::always_inline]] void find(const Points& at) {
    std::array<std::uint32_t, kLanes> base{};
    for (int axis = 0; axis < Dim; ++axis) {
      const int last = last_[axis], upper = std::max(0, last - 1);
      const T end = static_cast<T>(last);
      const std::uint32_t stride = stride_[axis];
#pragma omp simd
      for (int lane = 0; lane < kLanes; ++lane) {
        const T coordinate = at[axis][lane];
        T clamped = coordinate > T(0) ? coordinate : T(0);
        clamped = clamped < end ? clamped : end;
        int cell = static_cast<int>(clamped);
        cell = cell < upper ? cell : upper;
        fraction_[axis][lane] = coordinate == coordinate ? clamped - static_cast<T>(cell) : coordinate;
        slope_[axis][lane] = (coordinate > T(0)) & (coordinate < end) ? T(1) : T(0);
        low_[axis][lane] = cell;
        base[lane] += stride * static_cast<std::uint32_t>(cell);
      }
    }
    base_ = base;
  }

  /// Index along the last axis of one of the cells.
  int plane(int lane) const { return low_[Dim - 1][lane]; }

  /// One of the cells.
  [[gnu::always_inline]] LinearCell<Dim, T> cell(int lane) const {
    LinearCell<Dim, T> cell;
    cell.base = base_[lane];
    for (int axis = 0; axis < Dim; ++axis) {
      cell.low[axis] = low_[axis][lane];
      cell.fraction[axis] = fraction_[axis][lane];
      cell.slope[axis] = slope_[axis][lane];
      cell.step[axis] = last_[axis] > 0 ? stride_[axis] : 0;
    }
    return cell;
  }

  /// Values of a scalar field, and `gradient` by axis, d value / d index coordinate, where it is given.
  [[gnu::always_inline]] Lanes value(const T* field, Points* gradient = nullptr) const {
    std::array<Lanes, kCorners> values;
    fetch(field, values);
    Lanes out;
#pragma omp simd
    for (int lane = 0; lane < kLanes; ++lane) {
      T v[kCorners], slopes[Dim][kCorners / 2];
      for (int k = 0; k < kCorners; ++k) v[k] = values[k][lane];
#pragma GCC unroll 3
      for (int axis = 0; axis < Dim; ++axis) {
        const T fraction = fraction_[axis][lane], rest = 1 - fraction;
        const int half = kCorners >> (axis + 1);
        if (gradient) {
#pragma GCC unroll 3
          for (int before = 0; before < axis; ++before)
#pragma GCC unroll 4
            for (int k = 0; k < half; ++k)
              slopes[before][k] = rest * slopes[before][2 * k] + fraction * slopes[before][2 * k + 1];
#pragma GCC unroll 4
          for (int k = 0; k < half; ++k) slopes[axis][k] = slope_[axis][lane] * (v[2 * k + 1] - v[2 * k]);
        }
#pragma GCC unroll 4
        for (int k = 0; k < half; ++k) v[k] = rest * v[2 * k] + fraction * v[2 * k + 1];
      }
      out[lane] = v[0];
      if (gradient)
        for (int axis = 0; axis < Dim; ++axis) (*gradient)[axis][lane] = slopes[axis][0];
    }
    return out;
  }

 private:
  [[gnu::always_inline]] void fetch(const T* field, std::array<Lanes, kCorners>& values) const {
    std::array<std::size_t, kCorners> offset{};
    for (int corner = 0; corner < kCorners; ++corner)
      for (int axis = 0; axis < Dim; ++axis)
        if ((corner >> axis & 1) && last_[axis] > 0) offset[corner] += stride_[axis];
    for (int lane = 0; lane < kLanes; ++lane) {
      const T* at = field + base_[lane];
#pragma GCC unroll 8
      for (int corner = 0; corner < kCorners; ++corner) values[corner][lane] = at[offset[corner]];
    }
  }

  std::array<int, Dim> last_;
  std::array<std::uint32_t, Dim> stride_;
  std::array<std::uint32_t, kLanes> base_;
  std::array<std::array<int, kLanes>, Dim> low_;
  Points fraction_, slope_;
};

template <int Dim, class T>
using LanePoints = typename CellLanes<Dim, T>::Points;

/// The first `count` values of an interleaved field, by component; 0 beyond them.
template <int Dim, class T>
[[gnu::always_inline]] inline LanePoints<Dim, T> lanes_of(const T* field, int count) {
  LanePoints<Dim, T> values{};
  for (int lane = 0; lane < count; ++lane)
    for (int c = 0; c < Dim; ++c) values[c][lane] = field[Dim * lane + c];
  return values;
}

/// What SitePlacement says of the sites from `index` on along x, with displacements `mm`.
template <int Dim, class T>
[[gnu::always_inline]] inline LanePoints<Dim, T> placed(const SitePlacement<Dim, T>& place, const Index<Dim>& index,
                                                        const LanePoints<Dim, T>& mm) {
  LanePoints<Dim, T> at;
  for (int axis = 0; axis < Dim; ++axis) {
    const double scale = place.scale[axis], shift = place.shift[axis], per_mm = place.per_mm[axis];
#pragma omp simd
    for (int lane = 0; lane < CellLanes<Dim, T>::kLanes; ++lane)
      at[axis][lane] = static_cast<T>((index[axis] + (axis == 0 ? lane : 0)) * scale + shift +
                                      static_cast<double>(mm[axis][lane]) * per_mm);
  }
  return at;
}

}  // namespace saltus
