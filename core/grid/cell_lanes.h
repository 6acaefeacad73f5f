#pragma once

#include "core/grid/cell_rows.h"
#include "core/grid/interpolation.h"
#include "core/support/registers.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <utility>

namespace saltus {

/// Two or three components at neighbouring sites, a register for each, one after the other; what else stands in it
/// means nothing.
template <class T>
using LaneVectors = std::array<typename CellRows<T>::Vector, 16>;

/// 1 for some of the sites, 0 for the others and nothing else: as wide as the lanes it is found in.
using LaneMask = std::array<std::int32_t, 16>;

/// Cells (LinearCell) of neighbouring sites, side by side: where they are, and what a scalar field is there, is worked
/// out in lanes; only the values at the corners are fetched one by one, and fields of vectors taken site by site, rows
/// of a cell at a time (CellRows). For loops over rows of sites (visit_pieces).
template <int Dim, class T>
class CellLanes {
 public:
  static constexpr int kLanes = 16;
  static constexpr int kCorners = 1 << Dim;
  using Lanes = std::array<T, kLanes>;
  using Points = std::array<Lanes, Dim>;  ///< by axis
  using Vector = typename CellRows<T>::Vector;
  using Vectors = LaneVectors<T>;

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

  /// Whether any corner of the first `count` cells has an index along the last axis that is in [begin, end).
  bool reach(int count, int begin, int end) const {
    const int last = begin - (last_[Dim - 1] > 0);
    int any = 0;
#pragma omp simd reduction(| : any)
    for (int lane = 0; lane < kLanes; ++lane) {
      const int low = low_[Dim - 1][lane];
      any |= (low >= last) & (low < end) & (lane < count);
    }
    return any;
  }

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

  /// On a sample, where cells meet, a slope has a jump, and the `gradient` that `value` finds is that of the upper
  /// cell. Here it becomes the mean of both: what a small step to either side brings on average.
  [[gnu::noinline]] void centre_gradient(const T* field, const Lanes& values, Points& gradient) const {
    for (int axis = 0; axis < Dim; ++axis) {
      CellLanes below = *this;
      for (int lane = 0; lane < kLanes; ++lane) below.base_[lane] -= is_on_sample(axis, lane) ? stride_[axis] : 0;
      const Lanes before = below.value(field);
      Lanes& slopes = gradient[axis];
      for (int lane = 0; lane < kLanes; ++lane)
        if (is_on_sample(axis, lane)) slopes[lane] = (slopes[lane] + (values[lane] - before[lane])) / 2;
    }
  }

  /// take(lane, value) for the first `count` lanes, with what an interleaved field of vectors is in their cells.
  template <class Take>
  [[gnu::always_inline]] void visit_vectors(const T* field, int count, const Take& take) const {
    if constexpr (Dim == 3)
      if (has_rows()) {
        const Corners corners(*this);
        prefetch(field);
        for (int lane = 0; lane < count; ++lane)
          take(lane, corners.rows(field, lane).value(corners.x[lane], corners.y[lane], corners.z[lane]));
        return;
      }
    if constexpr (Dim == 2)
      if (last_[0] > 0) {
        for (int lane = 0; lane < count; ++lane) {
          const auto [low, high] = rows_of_2(field, lane);
          take(lane, along_row_of_2(between(low, high, fraction_[1][lane]), fraction_[0][lane]));
        }
        return;
      }
    for (int lane = 0; lane < count; ++lane) take(lane, vector_of(cell(lane).template value<Dim>(field)));
  }

  /// take(lane, value, gradient), the latter by axis sum_c dual[c] * d value[c] / d index coordinate.
  template <class Take>
  [[gnu::always_inline]] void visit_gradients(const T* field, const Vectors& dual, int count, const Take& take) const {
    if constexpr (Dim == 3)
      if (has_rows()) {
        const Corners corners(*this);
        prefetch(field);
        const bool any_clamped = is_any_clamped();
        for (int lane = 0; lane < count; ++lane) {
          Vector slopes[3];
          const Vector value =
              corners.rows(field, lane).value_and_slopes(corners.x[lane], corners.y[lane], corners.z[lane], slopes);
          for (int axis = 0; axis < 3; ++axis) slopes[axis] *= dual[lane];
          Vector gradient = sums_of_three(slopes);
          if (any_clamped) gradient *= Vector{slope_[0][lane], slope_[1][lane], slope_[2][lane]};
          take(lane, value, gradient);
        }
        return;
      }
    if constexpr (Dim == 2)
      if (last_[0] > 0) {
        for (int lane = 0; lane < count; ++lane) {
          const auto [low, high] = rows_of_2(field, lane);
          const T x = fraction_[0][lane];
          const Vector row = between(low, high, fraction_[1][lane]);
          const Vector along_x = dual[lane] * (upper_of_2(row) - row),
                       along_y = dual[lane] * along_row_of_2(high - low, x);
          take(lane, along_row_of_2(row, x),
               Vector{slope_[0][lane] * (along_x[0] + along_x[1]), slope_[1][lane] * (along_y[0] + along_y[1])});
        }
        return;
      }
    for (int lane = 0; lane < count; ++lane) {
      std::array<T, Dim> of_lane, gradient;
      for (int c = 0; c < Dim; ++c) of_lane[c] = dual[lane][c];
      const Vector value = vector_of(cell(lane).template value_and_gradient<Dim>(field, of_lane, gradient));
      take(lane, value, vector_of(gradient));
    }
  }

  /// Transpose of `visit_vectors`: adds `given`, of the first `count` lanes that are in `wanted`, to the corners whose
  /// index along the last axis is in [begin, end). Every fourth lane comes first, and what a corner gets is rounded
  /// alike, whatever the range is; tests hold the compiler to that.
  [[gnu::noinline]] void spread(const Vectors& given, int count, const LaneMask& wanted, int begin, int end,
                                T* field) const {
    if constexpr (Dim == 3)
      if (has_rows())
        return are_all(wanted, count) && are_within(count, begin, end)
                   ? spread_rows(
                         given, count, field, [](int) { return true; }, [](int) { return true; })
                   : spread_rows(
                         given, count, field,
                         [&](int lane) { return wanted[lane] && low_[2][lane] >= begin && low_[2][lane] < end; },
                         [&](int lane) {
                           const int high = low_[2][lane] + (last_[2] > 0);
                           return wanted[lane] && high >= begin && high < end;
                         });
    if constexpr (Dim == 2)
      if (last_[0] > 0) return spread_rows_of_2(given, count, wanted, begin, end, field);
    for (int first = 0; first < kApart; ++first)
      for (int lane = first; lane < count; lane += kApart) {
        if (!wanted[lane]) continue;
        std::array<T, Dim> of_lane;
        for (int c = 0; c < Dim; ++c) of_lane[c] = given[lane][c];
        cell(lane).template spread<Dim>(of_lane, begin, end, field);
      }
  }

 private:
  static constexpr int kApart = 4;  ///< lanes that are written one after the other

  /// Where the corners of 3-D cells are, and fractions, by lane: what loops over lanes would else look up again after
  /// each value they write.
  struct Corners {
    const T *x, *y, *z;
    const std::uint32_t* base;
    std::size_t row, plane;

    explicit Corners(const CellLanes& cells)
        : x(cells.fraction_[0].data()),
          y(cells.fraction_[1].data()),
          z(cells.fraction_[Dim - 1].data()),
          base(cells.base_.data()),
          row(cells.last_[1] > 0 ? 3 * std::size_t{cells.stride_[1]} : 0),
          plane(cells.last_[Dim - 1] > 0 ? 3 * std::size_t{cells.stride_[Dim - 1]} : 0) {}
    [[gnu::always_inline]] CellRows<T> rows(const T* field, int lane) const {
      return CellRows<T>(field + 3 * std::size_t{base[lane]}, row, plane);
    }
  };

  /// Not at the border, where the slope is 0 by convention: what lies on a sample then has one below.
  bool is_on_sample(int axis, int lane) const { return (fraction_[axis][lane] == T(0)) & (slope_[axis][lane] > T(0)); }

  /// Whether corners are taken row by row; where the lattice has one sample along x there are no rows.
  bool has_rows() const { return Dim == 3 && last_[0] > 0; }
  static bool are_all(const LaneMask& wanted, int count) {
    int all = 1;
#pragma omp simd reduction(& : all)
    for (int lane = 0; lane < kLanes; ++lane) all &= wanted[lane] | (lane >= count);
    return all;
  }
  bool are_within(int count, int begin, int end) const {
    const int last = end - (last_[Dim - 1] > 0);
    int all = 1;
#pragma omp simd reduction(& : all)
    for (int lane = 0; lane < kLanes; ++lane) {
      const int low = low_[Dim - 1][lane];
      all &= ((low >= begin) & (low < last)) | (lane >= count);
    }
    return all;
  }
  bool is_any_clamped() const {
    T least = 1;
    for (int axis = 0; axis < Dim; ++axis)
#pragma omp simd reduction(min : least)
      for (int lane = 0; lane < kLanes; ++lane) least = std::min(least, slope_[axis][lane]);
    return least < 1;
  }

  /// Rows of a moved lattice are too short for the machine to foresee them. What the next rows of sites will be the
  /// first to need comes near, and from memory what the next plane of sites will.
  [[gnu::always_inline]] void prefetch(const T* field, bool to_write = false) const {
    const std::size_t plane = stride_[Dim - 1], row = stride_[1];
    for (int lane = 0; lane < kLanes; lane += 5)  // where a site has about a cell, four lines hold 16 vectors of float
      for (const std::size_t ahead : {2 * plane + 2 * row, 2 * plane + row, plane + 2 * row}) {
        // As a number: a pointer must not leave its field.
        const auto at = reinterpret_cast<const void*>(reinterpret_cast<std::uintptr_t>(field) +
                                                      Dim * sizeof(T) * (base_[lane] + ahead));
        if (to_write)
          __builtin_prefetch(at, 1);
        else
          __builtin_prefetch(at);
      }
  }

  [[gnu::always_inline]] static Vector vector_of(const std::array<T, Dim>& value) {
    Vector vector{};
    for (int c = 0; c < Dim; ++c) vector[c] = value[c];
    return vector;
  }
  /// Of each of three vectors the sum of its three components.
  [[gnu::always_inline]] static Vector sums_of_three(const Vector (&v)[3]) {
    const Vector low = __builtin_shufflevector(v[0], v[1], 0, 4, 1, 5);   // x0 y0 x1 y1
    const Vector high = __builtin_shufflevector(v[0], v[1], 2, 6, 2, 6);  // x2 y2
    return __builtin_shufflevector(low, v[2], 0, 1, 4, 4) + __builtin_shufflevector(low, v[2], 2, 3, 5, 5) +
           __builtin_shufflevector(high, v[2], 0, 1, 6, 6);
  }

  /// Neighbouring sites write to the same corners: one after the other, each would wait until what the one before
  /// wrote has arrived in the cache. Every fourth one comes later, when it has. `lower(lane)` and `upper(lane)`:
  /// whether a cell's lower plane is added to, and its upper one.
  template <class Lower, class Upper>
  [[gnu::always_inline]] void spread_rows(const Vectors& given, int count, T* field, const Lower& lower,
                                          const Upper& upper) const {
    Lanes weights[4];
    for (int lane = 0; lane < kLanes; ++lane) {
      const T y = fraction_[1][lane], z = fraction_[2][lane];
      weights[0][lane] = (1 - y) * (1 - z);
      weights[1][lane] = y * (1 - z);
      weights[2][lane] = (1 - y) * z;
      weights[3][lane] = y * z;
    }
    prefetch(field, true);
    const Corners corners(*this);
    const std::size_t row = corners.row, plane = corners.plane;
    for (int first = 0; first < kApart; ++first)
      for (int lane = first; lane < count; lane += kApart) {
        const typename CellRows<T>::Share share(given[lane], corners.x[lane]);
        T* const at = field + 3 * std::size_t{corners.base[lane]};
        if (lower(lane)) {
          share.add(weights[0][lane], at);
          share.add(weights[1][lane], at + row);
        }
        if (upper(lane)) {
          share.add(weights[2][lane], at + plane);
          share.add(weights[3][lane], at + plane + row);
        }
      }
  }

  // In 2-D a row of a cell is four values: both components at two sites.

  /// Of a cell the lower row and the upper one.
  [[gnu::always_inline]] std::pair<Vector, Vector> rows_of_2(const T* field, int lane) const {
    const T* at = field + 2 * std::size_t{base_[lane]};
    Vector low, high;
    std::memcpy(&low, at, sizeof low);
    std::memcpy(&high, at + (last_[1] > 0 ? 2 * std::size_t{stride_[1]} : 0), sizeof high);
    return {low, high};
  }
  /// Exactly one of them where t is 0 or 1.
  [[gnu::always_inline]] static Vector between(const Vector& a, const Vector& b, T t) { return a - t * a + t * b; }
  [[gnu::always_inline]] static Vector upper_of_2(const Vector& row) {
    return __builtin_shufflevector(row, row, 2, 3, 2, 3);
  }
  /// Two components; the others mean nothing.
  [[gnu::always_inline]] static Vector along_row_of_2(const Vector& row, T x) {
    return between(row, upper_of_2(row), x);
  }
  [[gnu::always_inline]] void spread_rows_of_2(const Vectors& given, int count, const LaneMask& wanted, int begin,
                                               int end, T* field) const {
    const bool has_upper = last_[1] > 0;
    const std::size_t row = has_upper ? 2 * std::size_t{stride_[1]} : 0;
    const auto add = [](const Vector& terms, T* to) __attribute__((always_inline)) {
      Vector sum;
      std::memcpy(&sum, to, sizeof sum);
      sum += terms;
      std::memcpy(to, &sum, sizeof sum);
    };
    for (int first = 0; first < kApart; ++first)
      for (int lane = first; lane < count; lane += kApart) {
        if (!wanted[lane]) continue;
        const T x = fraction_[0][lane], y = fraction_[1][lane], a = given[lane][0], b = given[lane][1];
        const Vector share = Vector{a, b, a, b} * Vector{1 - x, 1 - x, x, x};
        T* const at = field + 2 * std::size_t{base_[lane]};
        const int low = low_[1][lane], high = low + has_upper;
        if (low >= begin && low < end) add((1 - y) * share, at);
        if (high >= begin && high < end) add(y * share, at + row);
      }
  }

  /// Two values that are neighbours, as one of their size together.
  using Pair = double;
  static constexpr int kPairs = static_cast<int>(kRegisterLanes<Pair>);
  template <int... Lane>
  [[gnu::always_inline]] Register<T> pairs(const T* field, int first, std::integer_sequence<int, Lane...>) const {
    const auto pair = [&](int lane) __attribute__((always_inline)) {
      Pair two;
      std::memcpy(&two, field + base_[first + lane], sizeof two);
      return two;
    };
    return (Register<T>)Register<Pair>{pair(Lane)...};
  }

  [[gnu::always_inline]] void fetch(const T* field, std::array<Lanes, kCorners>& values) const {
    std::array<std::size_t, kCorners> offset{};
    for (int corner = 0; corner < kCorners; ++corner)
      for (int axis = 0; axis < Dim; ++axis)
        if ((corner >> axis & 1) && last_[axis] > 0) offset[corner] += stride_[axis];
    // Values that a register is put together from one by one go through memory. Two of a row are one load, and there
    // are half as many.
    if constexpr (kHasRegisters && 2 * sizeof(T) == sizeof(Pair))
      if (last_[0] > 0) {
        constexpr std::make_integer_sequence<int, kPairs> lanes;
        for (int corner = 0; corner < kCorners; corner += 2)
          for (int lane = 0; lane < kLanes; lane += 2 * kPairs) {
            const Register<T> low = pairs(field + offset[corner], lane, lanes),
                              high = pairs(field + offset[corner], lane + kPairs, lanes);
            store<T>(every_second<0, T>(low, high), values[corner].data() + lane);
            store<T>(every_second<1, T>(low, high), values[corner + 1].data() + lane);
          }
        return;
      }
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

}  // namespace saltus
