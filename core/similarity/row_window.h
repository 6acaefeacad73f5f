#pragma once

#include <algorithm>
#include <cstddef>

#include "core/support/registers.h"

namespace saltus {

/// Sums over windows of 2 Radius + 1 neighbours along rows of several quantities, a register after the other:
/// neighbours are lanes of the registers beside it, so that nothing is loaded twice.
template <int Radius, std::size_t Quantities, class T>
class RowWindow {
 public:
  static constexpr int kMostRadius = 4;  ///< lanes of the narrowest register
  static_assert(0 <= Radius && Radius <= kMostRadius);

  /// Of rows whose first registers lie at `first`, `stride` apart, and whose registers follow each other `step` apart.
  /// Unless the radius is 0, a register before the first is read, and one after the last.
  [[gnu::always_inline]] RowWindow(const T* first, std::size_t stride, std::size_t step)
      : next_(first), stride_(stride), step_(step) {
    if constexpr (Radius > 0) {
#pragma GCC unroll 6
      for (std::size_t k = 0; k < Quantities; ++k) {
        here_[k] = load(next_ + k * stride_);
        before_[k] = followers(load(next_ + k * stride_ - step_), here_[k]);
      }
    }
  }

  [[gnu::always_inline]] void next(Register<T> (&sums)[Quantities]) {
    if constexpr (Radius > 0) next_ += step_;
#pragma GCC unroll 6
    for (std::size_t k = 0; k < Quantities; ++k) {
      const Register<T> entering = load(next_ + k * stride_);
      if constexpr (Radius == 0) {
        sums[k] = entering;
      } else {
        const Register<T> own = followers(here_[k], entering);
        sums[k] = shifted<static_cast<int>(kRegisterLanes<T>) - Radius, T>(before_[k], own) +
                  (own + shifted<Radius, T>(here_[k], entering));
        before_[k] = own;
        here_[k] = entering;
      }
    }
    if constexpr (Radius == 0) next_ += step_;
  }

 private:
  /// Each lane and the `Radius` - 1 that follow it.
  [[gnu::always_inline]] static Register<T> followers(const Register<T>& here, const Register<T>& next) {
    Register<T> sum = here;
    if constexpr (Radius > 1) sum += shifted<1, T>(here, next);
    if constexpr (Radius > 2) sum += shifted<2, T>(here, next);
    if constexpr (Radius > 3) sum += shifted<3, T>(here, next);
    return sum;
  }

  const T* next_;
  std::size_t stride_, step_;
  Register<T> here_[Quantities], before_[Quantities];
};

/// out[x] = sum of padded[x + j] over 0 <= j <= 2 radius, for `count` values x. `padded` has count + 2 radius values
/// and is overwritten. Sums of 1, 2, 4, ... neighbours are put together, so nothing is carried along the row and the
/// cost grows with the logarithm of the radius.
template <class T>
void sum_along_row(std::size_t count, int radius, T* padded, T* out) {
  const std::size_t width = 2 * static_cast<std::size_t>(radius) + 1;
  std::size_t summed = 0;  // neighbours that are in `out`
  std::fill_n(out, count, T(0));
  for (std::size_t w = 1; w <= width; w *= 2) {  // padded[x] holds the sum of w values from x on
    if (width & w) {
      const T* from = padded + summed;
#pragma omp simd
      for (std::size_t x = 0; x < count; ++x) out[x] += from[x];
      summed += w;
    }
    const std::size_t left = count + width - 1 - std::min(count + width - 1, 2 * w - 1);
    for (std::size_t x = 0; x < left; ++x) padded[x] += padded[x + w];
  }
}

}  // namespace saltus
