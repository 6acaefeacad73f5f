#pragma once

#include "core/support/registers.h"

#include <cstddef>
#include <utility>

namespace saltus {

/// Swaps the off-diagonal quarters of every square of 2 `Distance` lanes, then those of smaller ones.
template <int Distance, class T>
[[gnu::always_inline]] inline void swap_quarters(Register<T> (&tile)[kRegisterLanes<T>]) {
  constexpr int lanes = kRegisterLanes<T>;
  const auto exchange = [&]<int... k>(std::integer_sequence<int, k...>) {
#pragma GCC unroll 16
    for (int i = 0; i < lanes; ++i) {
      if (i & Distance) continue;
      const Register<T> low = tile[i], high = tile[i + Distance];
      tile[i] = __builtin_shufflevector(low, high, (k & Distance ? lanes + k - Distance : k)...);
      tile[i + Distance] = __builtin_shufflevector(low, high, (k & Distance ? lanes + k : k + Distance)...);
    }
  };
  exchange(std::make_integer_sequence<int, lanes>());
  if constexpr (Distance > 1) swap_quarters<Distance / 2, T>(tile);
}

/// Of a square tile as wide as a register, whose rows are so far apart, into another: value k of row i becomes value i
/// of row k. `adds`: to what is there.
template <class T>
[[gnu::always_inline]] inline void transpose_tile(const T* from, std::size_t from_step, bool adds, T* to,
                                                  std::size_t to_step) {
  constexpr int lanes = kRegisterLanes<T>;
  Register<T> tile[lanes];
#pragma GCC unroll 16
  for (int i = 0; i < lanes; ++i) tile[i] = load(from + static_cast<std::size_t>(i) * from_step);
  swap_quarters<lanes / 2, T>(tile);
  if (adds) {
#pragma GCC unroll 16
    for (int i = 0; i < lanes; ++i) tile[i] += load<T>(to + static_cast<std::size_t>(i) * to_step);
  }
#pragma GCC unroll 16
  for (int i = 0; i < lanes; ++i) store(tile[i], to + static_cast<std::size_t>(i) * to_step);
}

}  // namespace saltus
