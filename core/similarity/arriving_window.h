#pragma once

#include <cstddef>

#include "core/support/registers.h"

namespace saltus {

/// Sums over windows of 2 radius + 1 rows (or planes) that arrive one after the other: each is turned into the sum of
/// the window that it completes. What came before the first one is 0.
///
/// A window is `radius` pairs of rows and one row more. Pairs are summed once, for all windows that hold them. Each sum
/// is nevertheless made anew from the rows in it: nothing is carried on and on.
///
/// `Known`: the radius, or -1 when only the program that runs knows it.
template <int Known, class T>
class ArrivingWindow {
  // Loops over quantities are unrolled, since an array that is indexed at run time does not stay in registers.
 public:
  /// The row that arrives, counted from 0 up, none left out.
  ArrivingWindow(int radius, int row) : radius_(radius), ends_pair_(row % 2 == 0) {
    if (radius == 0) return;
    pair_ = (row + 1) / 2 % radius;  // a row that waits for the second one takes the place of the pair
    second_ = radius + row / 2 % radius;
  }
  /// What is kept for each register of a row, 0 at first: the last pairs, then the second rows of these.
  static std::size_t state(int radius, std::size_t quantities) {
    return static_cast<std::size_t>(2 * radius) * quantities * kRegisterLanes<T>;
  }
  template <std::size_t Quantities>
  [[gnu::always_inline]] void arrive(T* state, Register<T> (&row)[Quantities]) const {
    constexpr std::size_t lanes = kRegisterLanes<T>, slot = Quantities * lanes;
    const int radius = Known < 0 ? radius_ : Known;
    if (radius == 0) return;
    T* own = state + static_cast<std::size_t>(pair_) * slot;
    Register<T> sums[Quantities];
#pragma GCC unroll 6
    for (std::size_t k = 0; k < Quantities; ++k) sums[k] = load(own + k * lanes) + row[k];
    if (ends_pair_) {
#pragma GCC unroll 6
      for (std::size_t k = 0; k < Quantities; ++k) store<T>(sums[k], own + k * lanes);
    } else {
#pragma GCC unroll 6
      for (std::size_t k = 0; k < Quantities; ++k) store<T>(row[k], own + k * lanes);
    }
    for (int i = 1, at = pair_; i < radius; ++i) {
      at = at == 0 ? radius - 1 : at - 1;
      const T* pair = state + static_cast<std::size_t>(at) * slot;
#pragma GCC unroll 6
      for (std::size_t k = 0; k < Quantities; ++k) sums[k] += load(pair + k * lanes);
    }
    if (ends_pair_) {
      T* second = state + static_cast<std::size_t>(second_) * slot;
#pragma GCC unroll 6
      for (std::size_t k = 0; k < Quantities; ++k) {
        sums[k] += load(second + k * lanes);
        store<T>(row[k], second + k * lanes);
      }
    }
#pragma GCC unroll 6
    for (std::size_t k = 0; k < Quantities; ++k) row[k] = sums[k];
  }

 private:
  int radius_, pair_ = 0, second_ = 0;
  bool ends_pair_;
};

}  // namespace saltus
