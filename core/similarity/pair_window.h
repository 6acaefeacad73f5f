#pragma once

#include <cstddef>

#include "core/support/registers.h"

namespace saltus {

/// Sums over windows of 2 radius + 1 rows (or planes) that arrive in pairs: each row is turned into the sum of the
/// window that it completes. What came before the first pair is 0.
///
/// A window is `radius` pairs and one row more, the first one of the next pair or the second one of the pair before.
/// Pairs are summed once, for all windows that hold them. Each sum is nevertheless made anew from the rows in it:
/// nothing is carried on and on.
///
/// `Known`: the radius, or -1 when only the program that runs knows it.
template <int Known, class T>
class PairWindow {
  // Loops over quantities are unrolled, since an array that is indexed at run time does not stay in registers.
 public:
  /// The pair that arrives, counted from 0 up, none left out unless it is 0.
  PairWindow(int radius, int pair) : radius_(radius), oldest_(radius == 0 ? 0 : pair % radius) {}
  /// What is kept for each register of a row, 0 at first: the last pairs, each with its second row.
  static std::size_t state(int radius, std::size_t quantities) {
    return static_cast<std::size_t>(2 * radius) * quantities * kRegisterLanes<T>;
  }
  template <std::size_t Quantities>
  [[gnu::always_inline]] void arrive(T* state, Register<T> (&first)[Quantities],
                                     Register<T> (&second)[Quantities]) const {
    constexpr std::size_t lanes = kRegisterLanes<T>, slot = 2 * Quantities * lanes;
    const int radius = Known < 0 ? radius_ : Known;
    if (radius == 0) return;
    Register<T> inner[Quantities] = {};  // of the pairs that both windows hold, without the one that arrives
    if (radius > 1) {
      int at = oldest_;
      const auto next_pair = [&] {
        at = at == radius - 1 ? 0 : at + 1;
        return state + static_cast<std::size_t>(at) * slot;
      };
      const T* pair = next_pair();
#pragma GCC unroll 6
      for (std::size_t k = 0; k < Quantities; ++k) inner[k] = load(pair + k * lanes);
      for (int i = 2; i < radius; ++i) {
        pair = next_pair();
#pragma GCC unroll 6
        for (std::size_t k = 0; k < Quantities; ++k) inner[k] += load(pair + k * lanes);
      }
    }
    T* oldest = state + static_cast<std::size_t>(oldest_) * slot;
#pragma GCC unroll 6
    for (std::size_t k = 0; k < Quantities; ++k) {
      T *old_pair = oldest + k * lanes, *old_second = oldest + (Quantities + k) * lanes;
      const Register<T> pair = first[k] + second[k];
      const Register<T> before = load(old_pair) + first[k], after = load(old_second) + pair;
      store<T>(pair, old_pair);
      store<T>(second[k], old_second);
      first[k] = radius > 1 ? before + inner[k] : before;
      second[k] = radius > 1 ? after + inner[k] : after;
    }
  }

 private:
  int radius_, oldest_;
};

}  // namespace saltus
