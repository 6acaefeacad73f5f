#pragma once

#include "core/support/registers.h"

#include <cstddef>
#include <cstring>
#include <utility>

namespace saltus {

/// Lanes of the pieces that a register is put together from as they are loaded: a processor does that beside the
/// shuffles, of which half are left.
template <class T>
constexpr int kPieceLanes = 16 / sizeof(T);

template <class T>
struct PieceOf {
  typedef T Type __attribute__((vector_size(16)));
};

template <class Wide, class Narrow, int... k>
[[gnu::always_inline]] inline Wide joined(const Narrow& low, const Narrow& high, std::integer_sequence<int, k...>) {
  return __builtin_shufflevector(low, high, k...);
}

/// A register of pieces that are `step` apart.
template <class T>
[[gnu::always_inline]] inline Register<T> load_pieces(const T* from, std::size_t step) {
  typedef typename PieceOf<T>::Type Piece;
  typedef T Half __attribute__((vector_size(32)));
  constexpr int half = 32 / sizeof(T);
  const auto piece = [&](std::size_t i) {
    Piece values;
    std::memcpy(&values, from + i * step, sizeof values);
    return values;
  };
  const auto join = [&](std::size_t i) {
    return joined<Half>(piece(i), piece(i + 1), std::make_integer_sequence<int, half>());
  };
  if constexpr (kRegisterBytes == 32)
    return join(0);
  else
    return joined<Register<T>>(join(0), join(2), std::make_integer_sequence<int, 2 * half>());
}

/// Of a piece's registers: swaps the off-diagonal quarters of every square of 2 `Distance` lanes, then those of smaller
/// ones.
template <int Distance, class T>
[[gnu::always_inline]] inline void swap_quarters(Register<T>* tile) {
  constexpr int lanes = kRegisterLanes<T>;
  const auto exchange = [&]<int... k>(std::integer_sequence<int, k...>) {
#pragma GCC unroll 16
    for (int i = 0; i < kPieceLanes<T>; ++i) {
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
/// of row k. `adds`: to what is there. The tiles must not overlap.
template <class T>
[[gnu::always_inline]] inline void transpose_tile(const T* from, std::size_t from_step, bool adds, T* to,
                                                  std::size_t to_step) {
  constexpr int lanes = kRegisterLanes<T>, piece = kPieceLanes<T>;  // a piece's values are those of so many columns
#pragma GCC unroll 8
  for (int column = 0; column < lanes; column += piece) {
    Register<T> tile[piece];
#pragma GCC unroll 4
    for (int i = 0; i < piece; ++i)
      tile[i] = load_pieces(from + static_cast<std::size_t>(i) * from_step + column, piece * from_step);
    swap_quarters<piece / 2, T>(tile);
#pragma GCC unroll 4
    for (int i = 0; i < piece; ++i) {
      T* row = to + static_cast<std::size_t>(column + i) * to_step;
      store<T>(adds ? tile[i] + load<T>(row) : tile[i], row);
    }
  }
}

}  // namespace saltus
