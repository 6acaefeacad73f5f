#pragma once

#include <cstddef>

#include "core/support/registers.h"

namespace saltus {

/// Sums over windows of 2 Radius + 1 neighbours along a row of several quantities, register by register, the outermost
/// neighbours counting `rim`. Of each register of the row all quantities lie together, then comes the next. Neighbours
/// are lanes of the registers beside it, so that nothing is loaded twice.
template <int Radius, std::size_t Quantities, class T>
class RimmedRowWindow {
 public:
  static constexpr int kMostRadius = 2;
  static_assert(0 <= Radius && Radius <= kMostRadius);

  /// Unless the radius is 0, a register before the first is read, and one after the last.
  [[gnu::always_inline]] RimmedRowWindow(const T* first, T rim) : next_(first), rim_(rim) {
    if constexpr (Radius > 0) {
#pragma GCC unroll 6
      for (std::size_t k = 0; k < Quantities; ++k) {
        before_[k] = load(next_ + k * kLanes - kStep);
        here_[k] = load(next_ + k * kLanes);
      }
      next_ += kStep;
    }
  }

  [[gnu::always_inline]] void next(Register<T> (&sums)[Quantities]) {
#pragma GCC unroll 6
    for (std::size_t k = 0; k < Quantities; ++k) {
      const Register<T> after = load(next_ + k * kLanes);
      if constexpr (Radius == 0) {
        sums[k] = after;
      } else {
        Register<T> sum = here_[k];
        if constexpr (Radius == 2) sum += beside<1>(k, after);
        sums[k] = sum + rim_ * beside<Radius>(k, after);
        before_[k] = here_[k];
        here_[k] = after;
      }
    }
    next_ += kStep;
  }

 private:
  static constexpr std::size_t kLanes = kRegisterLanes<T>, kStep = Quantities * kLanes;

  /// Both neighbours that are so far away.
  template <int By>
  [[gnu::always_inline]] Register<T> beside(std::size_t k, const Register<T>& after) const {
    return shifted<static_cast<int>(kLanes) - By, T>(before_[k], here_[k]) + shifted<By, T>(here_[k], after);
  }

  const T* next_;
  T rim_;
  Register<T> before_[Quantities], here_[Quantities];
};

}  // namespace saltus
