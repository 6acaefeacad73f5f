#pragma once

#include "core/support/signs.h"

#include <algorithm>
#include <cmath>

namespace saltus {

/// The one-dimensional C0 Wendland profile k0 of width sigma and its derivative, averaged over a cell of width h (box
/// B), at any distance r from the momentum and not at samples only: what a momentum makes that lies anywhere and is
/// turned anyhow. Mass and unit as in KernelTaps without their factor h, at r = t h the same numbers:
///
///     value   V(r) = 1/mass     k0 * B (r)     = (K(r + h/2) - K(r - h/2)) / (mass h)      K the antiderivative of k0
///     slope   S(r) = sigma/mass k0' * B (r)    = sigma (k0(r + h/2) - k0(r - h/2)) / (mass h)
///
/// and for energies, which average on both sides (L = B * B the hat),
///
///     value_gram     1/mass k0 * L           slope_gram   -sigma^2/mass k0'' * L     (holds the Dirac of k0'' at 0)
///
/// V' = S / sigma; S' is that of a function with kinks. Both are 0 beyond `reach`.
template <class T>
struct AveragedWendland {
  T sigma = 1, half = T(0.5), value_scale = 1, slope_scale = 1;  ///< half: of the cell
  T per_sigma = 1;

  AveragedWendland() = default;
  AveragedWendland(double width_mm, double cell_mm)
      : sigma(static_cast<T>(width_mm)),
        half(static_cast<T>(cell_mm / 2)),
        // mass = 2 sigma / 3, and the antiderivative of k0 is sigma / 3 (1 - q^3) on either side.
        value_scale(static_cast<T>(0.5 / cell_mm)),
        slope_scale(static_cast<T>(1.5 / cell_mm)),
        per_sigma(static_cast<T>(1 / width_mm)) {}

  T reach() const { return sigma + half; }

  /// What is left of 1 at the ends of the cell at r, as all that follows wants it; of a number or a register of them.
  template <class V>
  struct Ends {
    V below, above;  ///< r - h/2 and r + h/2
    V low, high;     ///< 1 - |.| / sigma there, or 0
  };
  template <class V>
  [[gnu::always_inline]] V rest(V r) const {
    const V left = T(1) - magnitude(r) * per_sigma;
    return left > 0 ? left : V{};  // std::max gives a reference, which no loop in lanes likes
  }
  template <class V>
  [[gnu::always_inline]] Ends<V> ends(V r) const {
    const V below = r - half, above = r + half;
    return {below, above, rest(below), rest(above)};
  }
  template <class V>
  [[gnu::always_inline]] V value(const Ends<V>& at) const {
    return value_scale * (with_sign<V>(T(1) - at.high * at.high * at.high, at.above) -
                          with_sign<V>(T(1) - at.low * at.low * at.low, at.below));
  }
  template <class V>
  [[gnu::always_inline]] V slope(const Ends<V>& at) const {
    return slope_scale * (at.high - at.low) * (at.high + at.low);
  }
  /// S'(r), where it exists.
  template <class V>
  [[gnu::always_inline]] V slope_derivative(const Ends<V>& at) const {
    return T(2) * slope_scale * per_sigma * (with_sign<V>(at.low, at.below) - with_sign<V>(at.high, at.above));
  }
  T value(T r) const { return value(ends(r)); }
  T slope(T r) const { return slope(ends(r)); }
  T slope_derivative(T r) const { return slope_derivative(ends(r)); }

  T value_gram(T r) const {
    const auto second = [this](T at) {  // antiderivative of the antiderivative of k0, divided by mass
      const T q = rest(at);
      return std::abs(at) / 2 - sigma / 8 * (1 - q * q * q * q);
    };
    return second_difference(r, second);
  }
  T slope_gram(T r) const {
    return -T(1.5) * sigma * second_difference(r, [this](T at) { return rest(at) * rest(at); });
  }

 private:
  template <class Function>
  T second_difference(T r, Function&& f) const {
    const T h = 2 * half;
    return (f(r + h) - 2 * f(r) + f(r - h)) / (h * h);
  }
};

}  // namespace saltus
