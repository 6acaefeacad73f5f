#pragma once

#include "core/grid/cell_row.h"

#include <cstddef>

// Not with clang, which rounds sums of registers otherwise than those of CellRow: what CellLanes::spread adds would
// depend on how.
#if defined(__AVX512VL__) && defined(__has_builtin) && !defined(__clang__)
#if __has_builtin(__builtin_ia32_loadups256_mask) && __has_builtin(__builtin_ia32_storeups256_mask)
#define SALTUS_ROWS_IN_REGISTERS
#endif
#endif

namespace saltus {

/// The corners of a 3-D cell of an interleaved field with three channels, for loops over many cells: what CellRow does,
/// with whole registers from beginning to end. All of it is inlined.
template <class T>
class CellRows {
 public:
  typedef T Vector __attribute__((vector_size(4 * sizeof(T))));  ///< three components; the fourth means nothing

  /// `at`: the lowest corner; `y` and `z`: how far the next row and plane are.
  [[gnu::always_inline]] CellRows(const T* at, std::size_t y, std::size_t z)
      : rows_{{Row::load(at), Row::load(at + y)}, {Row::load(at + z), Row::load(at + z + y)}} {}

  /// What the field is at fractions of the cell along the axes.
  [[gnu::always_inline]] Vector value(T x, T y, T z) const {
    return along_x(between(between(rows_[0][0], rows_[1][0], z), between(rows_[0][1], rows_[1][1], z), y), x);
  }

  /// Its derivative along each axis besides, as if no coordinate were clamped.
  [[gnu::always_inline]] Vector value_and_slopes(T x, T y, T z, Vector (&slopes)[3]) const {
    const Row low = between(rows_[0][0], rows_[1][0], z), high = between(rows_[0][1], rows_[1][1], z);
    const Row row = between(low, high, y);
    slopes[0] = upper(row) - row.four;
    slopes[1] = along_x(high - low, x);
    slopes[2] = along_x(between(rows_[1][0] - rows_[0][0], rows_[1][1] - rows_[0][1], y), x);
    return along_x(row, x);
  }

  /// What of `value` a row's two sites have, at fraction x between them, to be added to rows.
  class Share {
   public:
    [[gnu::always_inline]] Share(const Vector& value, T x) : row_(Row::of({value[0], value[1], value[2]}, 1 - x, x)) {}
    [[gnu::always_inline]] void add(T weight, T* to) const { (Row::load(to) + row_ * weight).store(to); }

   private:
    CellRow<T> row_;
  };

 private:
  using Row = CellRow<T>;

  /// Exactly one of them where t is 0 or 1.
  [[gnu::always_inline]] static Row between(const Row& a, const Row& b, T t) { return a - a * t + b * t; }
  [[gnu::always_inline]] static Vector upper(const Row& row) {
    const Vector two = __builtin_shufflevector(row.two, row.two, 0, 1, 0, 1);
    return __builtin_shufflevector(row.four, two, 3, 4, 5, 5);
  }
  [[gnu::always_inline]] static Vector along_x(const Row& row, T x) { return row.four - row.four * x + upper(row) * x; }

  Row rows_[2][2];  ///< by z and y
};

#ifdef SALTUS_ROWS_IN_REGISTERS
/// A row is one masked register, and the two of a plane are one twice as wide.
template <>
class CellRows<float> {
  typedef float Row __attribute__((vector_size(32)));

 public:
  typedef float Vector __attribute__((vector_size(16)));

  [[gnu::always_inline]] CellRows(const float* at, std::size_t y, std::size_t z)
      : front_(both(load(at), load(at + y))), back_(both(load(at + z), load(at + z + y))) {}

  [[gnu::always_inline]] Vector value(float x, float y, float z) const {
    return along_x(along_y(between(front_, back_, z), y), x);
  }

  [[gnu::always_inline]] Vector value_and_slopes(float x, float y, float z, Vector (&slopes)[3]) const {
    const Rows depth = between(front_, back_, z);
    const Row row = along_y(depth, y);
    slopes[0] = upper(row) - lower(row);
    slopes[1] = along_x(second(depth) - first(depth), x);
    slopes[2] = along_x(along_y(back_ - front_, y), x);
    return along_x(row, x);
  }

  class Share {
   public:
    [[gnu::always_inline]] Share(const Vector& value, float x) {
      constexpr Row at_lower = {1, 1, 1, 0, 0, 0, 0, 0}, change = {-1, -1, -1, 1, 1, 1, 0, 0};
      row_ = __builtin_shufflevector(value, value, 0, 1, 2, 0, 1, 2, 3, 3) * (at_lower + x * change);
    }
    [[gnu::always_inline]] void add(float weight, float* to) const {
      __builtin_ia32_storeups256_mask(to, load(to) + row_ * weight, kSix);
    }

   private:
    Row row_;
  };

 private:
  typedef float Rows __attribute__((vector_size(64)));
  static constexpr unsigned char kSix = 0x3f;

  /// Six values, the others 0; no other is read.
  [[gnu::always_inline]] static Row load(const float* at) { return __builtin_ia32_loadups256_mask(at, Row{}, kSix); }
  [[gnu::always_inline]] static Rows both(const Row& a, const Row& b) {
    return __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
  }
  [[gnu::always_inline]] static Row first(const Rows& rows) {
    return __builtin_shufflevector(rows, rows, 0, 1, 2, 3, 4, 5, 6, 7);
  }
  [[gnu::always_inline]] static Row second(const Rows& rows) {
    return __builtin_shufflevector(rows, rows, 8, 9, 10, 11, 12, 13, 14, 15);
  }
  [[gnu::always_inline]] static Vector lower(const Row& row) { return __builtin_shufflevector(row, row, 0, 1, 2, 3); }
  [[gnu::always_inline]] static Vector upper(const Row& row) { return __builtin_shufflevector(row, row, 3, 4, 5, 6); }

  template <class Lanes>
  [[gnu::always_inline]] static Lanes between(const Lanes& a, const Lanes& b, float t) {
    return a - t * a + t * b;
  }
  [[gnu::always_inline]] static Row along_y(const Rows& rows, float y) { return between(first(rows), second(rows), y); }
  [[gnu::always_inline]] static Vector along_x(const Row& row, float x) { return between(lower(row), upper(row), x); }

  Rows front_, back_;
};
#endif

}  // namespace saltus

#undef SALTUS_ROWS_IN_REGISTERS
