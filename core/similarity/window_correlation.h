#pragma once

#include <cstddef>

#include "core/support/registers.h"

namespace saltus {

/// The correlation of windows, a register of them, and what its derivatives are made of.
///
/// With window sums S of weighted images: mean_f = S_f / S_w, v_f = S_ff / S_w - mean_f^2, var_f = v_f + floor^2, and
/// so on; q = (var_f var_w)^-1/2, c = cov q. At a sample y of the window, f and w less their means,
///     dc/dw(y)      = weight(y) / S_w * ( q f - c / var_w w ),
///     dc/dweight(y) = ( q (f w - cov) - c/2 (f^2 - v_f) / var_f - c/2 (w^2 - v_w) / var_w ) / S_w.
template <class T>
struct WindowCorrelation {
  using Lanes = Register<T>;

  Lanes weight, seen;  ///< of the window; 1 where its samples weigh anything, else 0
  Lanes share;         ///< 1 / S_w
  Lanes mean_f, mean_w, v_f, v_w, cov;
  Lanes var_f, var_w;   ///< with the floor: v + e
  Lanes inverse, root;  ///< of their product

  /// Without weights: `samples_share` is one over the number of samples. `s`: f, w, f^2, w^2, f w.
  template <std::size_t Sums>
  [[gnu::always_inline]] void find(const Lanes (&s)[Sums], const Lanes& samples_share, const Lanes& floor2) {
    share = samples_share;
    mean_f = s[0] * share, mean_w = s[1] * share;
    const Lanes e_f = s[2] * share - mean_f * mean_f, e_w = s[3] * share - mean_w * mean_w;
    v_f = e_f > 0 ? e_f : Lanes{}, v_w = e_w > 0 ? e_w : Lanes{};
    var_f = v_f + floor2, var_w = v_w + floor2, cov = s[4] * share - mean_f * mean_w;
    // The root does not wait for the quotient.
    const Lanes var2 = var_f * var_w;
    inverse = 1 / var2, root = square_root<T>(var2);
  }
  /// With them, whose sum is s[5]. Where it is nothing c is 0; unless `is_for_weights`, also where the window itself
  /// has no weight, since nothing is asked of it then.
  [[gnu::always_inline]] void find_weighted(const Lanes (&s)[6], const Lanes& own_weight, const Lanes& floor2,
                                            bool is_for_weights) {
    weight = own_weight;
    const auto sees = is_for_weights ? s[5] > T(1e-6) : (s[5] > T(1e-6)) & (weight != 0);
    seen = sees ? Lanes{} + 1 : Lanes{};
    find(s, sees ? 1 / s[5] : Lanes{}, floor2);
  }

  [[gnu::always_inline]] Lanes correlation() const { return cov * (inverse * root); }

  /// What dc depends on of the window alone, so that a sample needs no more than the sums of these over the windows
  /// that hold it. `factor`: how much c counts, times `share`.
  ///     dc/dw(y)      = weight(y) (k0 f(y) - k1 w(y) - k2)
  ///     dc/dweight(y) = k5 - f(y) (k3 f(y) / 2 - k4) - w(y) (k1 w(y) / 2 + k2 - k0 f(y)).
  template <std::size_t Coefficients>
  [[gnu::always_inline]] void find_coefficients(const Lanes& factor, Lanes (&k)[Coefficients]) const {
    static_assert(Coefficients == 3 || Coefficients == 6);
    const Lanes q = inverse * root, c = cov * q;
    const Lanes a = factor * q, b = factor * c * (inverse * var_f);
    k[0] = a;
    k[1] = b;
    k[2] = a * mean_f - b * mean_w;
    if constexpr (Coefficients == 6) {
      const Lanes d = factor * c * (inverse * var_w);
      k[3] = d;
      k[4] = d * mean_f - a * mean_w;
      k[5] = a * (mean_f * mean_w - cov) - T(0.5) * (d * (mean_f * mean_f - v_f) + b * (mean_w * mean_w - v_w));
    }
  }
};

/// begin(x) and finish(x, what it gave) for each register of a row of `count` windows, in whole registers, at least
/// one. One is finished when the next one has begun, since quotient and root take longer than all the rest; `in_turn`:
/// before, where that would take more registers than there are.
template <bool in_turn, class T, class Begin, class Finish>
[[gnu::always_inline]] inline void for_windows(std::size_t count, const Begin& begin, const Finish& finish) {
  constexpr std::size_t lanes = kRegisterLanes<T>;
  if constexpr (in_turn) {
    for (std::size_t x = 0; x < count; x += lanes) finish(x, begin(x));
  } else {
    auto found = begin(0);
    for (std::size_t x = lanes; x < count; x += lanes) {
      const auto next = begin(x);
      finish(x - lanes, found);
      found = next;
    }
    finish(count - lanes, found);
  }
}

}  // namespace saltus
