#pragma once

#include "core/grid/cell_row.h"
#include "core/grid/lattice.h"

#include <algorithm>
#include <array>
#include <cstddef>

namespace saltus {

/// Cell of a lattice around a point, for (bi/tri)linear interpolation. Points outside are moved to the border, where
/// the derivative across it is zero; so a sampled field is constant beyond its lattice. What it does is the inside of
/// all loops over sites, hence always inline.
template <int Dim, class T>
struct LinearCell {
  std::size_t base;                   ///< site of the lowest corner
  Index<Dim> low;                     ///< its index
  std::array<T, Dim> fraction;        ///< in [0,1]
  std::array<std::size_t, Dim> step;  ///< site step to the upper corner along each axis, 0 where there is none
  std::array<T, Dim> slope;           ///< d fraction / d index coordinate: 1 inside, 0 where clamped

  /// For who finds cells otherwise (cell_lanes.h).
  LinearCell() = default;
  /// `at`: index coordinates, in samples.
  [[gnu::always_inline]] LinearCell(const Lattice<Dim>& lattice, const std::array<T, Dim>& at) {
    base = 0;
    std::size_t stride = 1;
    for (int axis = 0; axis < Dim; ++axis) {
      const int last = lattice.size[axis] - 1;
      const T coordinate = at[axis];
      // Without branches, and so that a NaN coordinate lands in a valid cell; its value stays visible through
      // `fraction`.
      const bool inside = coordinate > T(0) && coordinate < T(last);
      T clamped = coordinate > T(0) ? coordinate : T(0);
      clamped = clamped < T(last) ? clamped : T(last);
      int cell = static_cast<int>(clamped);
      cell -= cell == last && last > 0;
      low[axis] = cell;
      fraction[axis] = coordinate == coordinate ? clamped - T(cell) : coordinate;
      slope[axis] = inside ? T(1) : T(0);
      step[axis] = last > 0 ? stride : 0;
      base += stride * static_cast<std::size_t>(cell);
      stride *= static_cast<std::size_t>(lattice.size[axis]);
    }
  }

  static constexpr int corners = 1 << Dim;

  std::size_t corner(int bits) const {
    std::size_t site = base;
    for (int axis = 0; axis < Dim; ++axis)
      if (bits >> axis & 1) site += step[axis];
    return site;
  }

  T weight(int bits) const {
    T product = 1;
    for (int axis = 0; axis < Dim; ++axis) product *= (bits >> axis & 1) ? fraction[axis] : T(1) - fraction[axis];
    return product;
  }

  /// d weight / d index coordinate of `along`.
  T weight_slope(int bits, int along) const {
    T product = (bits >> along & 1) ? slope[along] : -slope[along];
    for (int axis = 0; axis < Dim; ++axis)
      if (axis != along) product *= (bits >> axis & 1) ? fraction[axis] : T(1) - fraction[axis];
    return product;
  }

  /// Value of an interleaved field with `Channels` channels.
  template <int Channels>
  [[gnu::always_inline]] std::array<T, Channels> value(const T* field) const {
    if constexpr (has_rows<Channels>)
      if (step[0] > 0) return rows_of(field).value(*this);
    std::array<T, Channels> sum{};
    for (int bits = 0; bits < corners; ++bits) {
      const T w = weight(bits);
      const T* at = field + Channels * corner(bits);
      for (int c = 0; c < Channels; ++c) sum[c] += w * at[c];
    }
    return sum;
  }

  /// sum_c dual[c] * d value[c] / d index coordinate, for each axis.
  template <int Channels>
  [[gnu::always_inline]] std::array<T, Dim> pulled_back_gradient(const T* field,
                                                                 const std::array<T, Channels>& dual) const {
    if constexpr (has_rows<Channels>)
      if (step[0] > 0) return rows_of(field).gradient(*this, dual);
    std::array<T, corners> along;
    for (int bits = 0; bits < corners; ++bits) {
      const T* at = field + Channels * corner(bits);
      T sum = 0;
      for (int c = 0; c < Channels; ++c) sum += dual[c] * at[c];
      along[bits] = sum;
    }
    return gradient_of(along);
  }

  /// `value`, with one look at the corners for it and pulled_back_gradient.
  template <int Channels>
  [[gnu::always_inline]] std::array<T, Channels> value_and_gradient(const T* field, const std::array<T, Channels>& dual,
                                                                    std::array<T, Dim>& gradient) const {
    if constexpr (has_rows<Channels>)
      if (step[0] > 0) {
        const Rows rows = rows_of(field);
        gradient = rows.gradient(*this, dual);
        return rows.value(*this);
      }
    std::array<T, corners> along;
    std::array<T, Channels> sum{};
    for (int bits = 0; bits < corners; ++bits) {
      const T w = weight(bits);
      const T* at = field + Channels * corner(bits);
      T product = 0;
      for (int c = 0; c < Channels; ++c) {
        sum[c] += w * at[c];
        product += dual[c] * at[c];
      }
      along[bits] = product;
    }
    gradient = gradient_of(along);
    return sum;
  }

  /// `value`, and d value[c] / d index coordinate `axis` as slopes[c][axis].
  template <int Channels>
  [[gnu::always_inline]] std::array<T, Channels> value_and_slopes(
      const T* field, std::array<std::array<T, Dim>, Channels>& slopes) const {
    if constexpr (has_rows<Channels>)
      if (step[0] > 0) {
        const Rows rows = rows_of(field);
        const auto along = rows.slopes(*this);
        for (int c = 0; c < Channels; ++c)
          for (int axis = 0; axis < Dim; ++axis) slopes[c][axis] = slope[axis] * along[axis][c];
        return rows.value(*this);
      }
    std::array<T, Channels> sum;
    for (int c = 0; c < Channels; ++c) {
      std::array<T, corners> values;
      for (int bits = 0; bits < corners; ++bits) values[bits] = field[Channels * corner(bits) + c];
      slopes[c] = gradient_of(values, &sum[c]);
    }
    return sum;
  }

  /// Transpose of `value`: adds the weights times `given` to the corners whose index along the last axis is in
  /// [begin, end).
  template <int Channels>
  [[gnu::always_inline]] void spread(const std::array<T, Channels>& given, int begin, int end, T* field) const {
    const auto is_in = [&](int upper) {
      const int index = low[Dim - 1] + (upper && step[Dim - 1] > 0 ? 1 : 0);
      return index >= begin && index < end;
    };
    if constexpr (has_rows<Channels>)
      if (step[0] > 0) {
        const CellRow<T> row = CellRow<T>::of(given, 1 - fraction[0], fraction[0]);
        for (int z = 0; z < 2; ++z) {
          if (!is_in(z)) continue;
          const T depth = z ? fraction[2] : 1 - fraction[2];
          T* lower = field + 3 * (base + (z ? step[2] : 0));
          T* upper = lower + 3 * step[1];
          (CellRow<T>::load(lower) + row * (depth * (1 - fraction[1]))).store(lower);
          (CellRow<T>::load(upper) + row * (depth * fraction[1])).store(upper);
        }
        return;
      }
    for (int bits = 0; bits < corners; ++bits) {
      if (!is_in(bits >> (Dim - 1) & 1)) continue;
      const T w = weight(bits);
      T* to = field + Channels * corner(bits);
      for (int c = 0; c < Channels; ++c) to[c] += w * given[c];
    }
  }

 private:
  /// Whether corners are taken row by row; where the lattice has one sample along x there are no rows.
  template <int Channels>
  static constexpr bool has_rows = Dim == 3 && Channels == 3;

  /// The rows of a 3-D cell by y and z.
  struct Rows {
    CellRow<T> row[2][2];

    [[gnu::always_inline]] std::array<T, 3> value(const LinearCell& cell) const {
      const T y = cell.fraction[1], z = cell.fraction[2];
      return ((row[0][0] * (1 - y) + row[1][0] * y) * (1 - z) + (row[0][1] * (1 - y) + row[1][1] * y) * z)
          .between(cell.fraction[0]);
    }
    /// By axis, as if no coordinate were clamped.
    [[gnu::always_inline]] std::array<std::array<T, 3>, 3> slopes(const LinearCell& cell) const {
      const T y = cell.fraction[1], z = cell.fraction[2];
      const CellRow<T> front = row[0][0] * (1 - y) + row[1][0] * y, back = row[0][1] * (1 - y) + row[1][1] * y;
      const CellRow<T> up = (row[1][0] - row[0][0]) * (1 - z) + (row[1][1] - row[0][1]) * z;
      return {(front * (1 - z) + back * z).difference(), up.between(cell.fraction[0]),
              (back - front).between(cell.fraction[0])};
    }
    [[gnu::always_inline]] std::array<T, 3> gradient(const LinearCell& cell, const std::array<T, 3>& dual) const {
      const auto along = slopes(cell);
      const auto with_dual = [&](const std::array<T, 3>& v) {
        return dual[0] * v[0] + dual[1] * v[1] + dual[2] * v[2];
      };
      return {cell.slope[0] * with_dual(along[0]), cell.slope[1] * with_dual(along[1]),
              cell.slope[2] * with_dual(along[2])};
    }
  };
  [[gnu::always_inline]] Rows rows_of(const T* field) const {
    Rows rows;
    for (int y = 0; y < 2; ++y)
      for (int z = 0; z < 2; ++z)
        rows.row[y][z] = CellRow<T>::load(field + 3 * (base + (y ? step[1] : 0) + (z ? step[2] : 0)));
    return rows;
  }

  /// d / d index coordinate of the interpolation of values at the corners, and that itself where `value` is given: axis
  /// by axis, so that every axis halves what is left.
  [[gnu::always_inline]] std::array<T, Dim> gradient_of(std::array<T, corners> values, T* value = nullptr) const {
    T slopes[Dim][corners / 2];
#pragma GCC unroll 3
    for (int axis = 0; axis < Dim; ++axis) {
      const int half = corners >> (axis + 1);
#pragma GCC unroll 3
      for (int before = 0; before < axis; ++before)
#pragma GCC unroll 4
        for (int k = 0; k < half; ++k)
          slopes[before][k] =
              slopes[before][2 * k] + fraction[axis] * (slopes[before][2 * k + 1] - slopes[before][2 * k]);
#pragma GCC unroll 4
      for (int k = 0; k < half; ++k) {
        const T difference = values[2 * k + 1] - values[2 * k];
        slopes[axis][k] = slope[axis] * difference;
        values[k] = values[2 * k] + fraction[axis] * difference;
      }
    }
    std::array<T, Dim> gradient;
    for (int axis = 0; axis < Dim; ++axis) gradient[axis] = slopes[axis][0];
    if (value) *value = values[0];
    return gradient;
  }
};

/// Index coordinates on one lattice of the points that the sites of another reach with a displacement. No division for
/// each point; a site's own coordinate is found in double, and so exactly where sites coincide, whatever T is.
template <int Dim, class T>
struct SitePlacement {
  std::array<double, Dim> scale, shift, per_mm;

  SitePlacement(const Lattice<Dim>& from, const Lattice<Dim>& to) {
    for (int axis = 0; axis < Dim; ++axis) {
      scale[axis] = from.spacing[axis] / to.spacing[axis];
      shift[axis] = (from.offset[axis] - to.offset[axis]) / to.spacing[axis];
      per_mm[axis] = 1 / to.spacing[axis];
    }
  }
  /// Site `index` with displacement `mm`.
  std::array<T, Dim> operator()(const Index<Dim>& index, const T* mm) const {
    std::array<T, Dim> at;
    for (int axis = 0; axis < Dim; ++axis)
      at[axis] = static_cast<T>(index[axis] * scale[axis] + shift[axis] + static_cast<double>(mm[axis]) * per_mm[axis]);
    return at;
  }
};

}  // namespace saltus
