#pragma once

#include <array>
#include <cstring>

namespace saltus {

/// The values of two neighbouring sites along x of an interleaved field with three channels: six that follow each other
/// in memory, and so two instructions where values one by one take six. The rows of a 3-D cell are interpolated along y
/// and z as wholes, and along x at the end.
template <class T>
struct CellRow {
  typedef T Four __attribute__((vector_size(4 * sizeof(T))));
  typedef T Two __attribute__((vector_size(2 * sizeof(T))));
  Four four;
  Two two;

  [[gnu::always_inline]] static CellRow load(const T* at) {
    CellRow row;
    std::memcpy(&row.four, at, sizeof(Four));
    std::memcpy(&row.two, at + 4, sizeof(Two));
    return row;
  }
  [[gnu::always_inline]] void store(T* at) const {
    std::memcpy(at, &four, sizeof(Four));
    std::memcpy(at + 4, &two, sizeof(Two));
  }
  /// low at the lower of the two sites, high at the upper.
  [[gnu::always_inline]] static CellRow of(const std::array<T, 3>& value, T low, T high) {
    return {Four{low * value[0], low * value[1], low * value[2], high * value[0]},
            Two{high * value[1], high * value[2]}};
  }

  [[gnu::always_inline]] CellRow operator+(const CellRow& other) const { return {four + other.four, two + other.two}; }
  [[gnu::always_inline]] CellRow operator-(const CellRow& other) const { return {four - other.four, two - other.two}; }
  [[gnu::always_inline]] CellRow operator*(T factor) const { return {four * factor, two * factor}; }

  /// What the row is at `fraction` from the lower site to the upper, and its difference.
  [[gnu::always_inline]] std::array<T, 3> between(T fraction) const {
    const T rest = 1 - fraction;
    return {rest * four[0] + fraction * four[3], rest * four[1] + fraction * two[0],
            rest * four[2] + fraction * two[1]};
  }
  [[gnu::always_inline]] std::array<T, 3> difference() const {
    return {four[3] - four[0], two[0] - four[1], two[1] - four[2]};
  }
};

}  // namespace saltus
