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
///     cross_gram     sigma/mass k0' * L
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

  /// Of the cell at r, as all that follows wants it, all in sigma; of a number or a register of them. The cell's ends
  /// are the nearer and the farther one, those of the cell at |r|: value is even, slope odd.
  template <class V>
  struct Ends {
    V r;
    V near_end;   ///< below 0 where the cell holds the momentum's place
    V near, far;  ///< what is left of 1 at the ends: 1 - |end|, or 0
  };
  template <class V>
  [[gnu::always_inline]] Ends<V> ends(V r) const {
    const V away = magnitude(r);
    const V near_end = away * per_sigma - half * per_sigma;
    return {r, near_end, positive_part<V>(T(1) - magnitude(near_end)),
            positive_part<V>((T(1) - half * per_sigma) - away * per_sigma)};
  }
  /// V / value_scale and S / slope_scale. What is left of 1 is never below 0, so that its sign may be flipped.
  template <class V>
  [[gnu::always_inline]] V value_shape(const Ends<V>& at) const {
    return (T(1) - at.far * at.far * at.far) - with_sign_flipped<V>(T(1) - at.near * at.near * at.near, at.near_end);
  }
  template <class V>
  [[gnu::always_inline]] V slope_shape(const Ends<V>& at) const {
    return with_sign_flipped<V>(at.far * at.far - at.near * at.near, at.r);
  }
  /// Their derivatives, where they exist.
  template <class V>
  [[gnu::always_inline]] V value_shape_derivative(const Ends<V>& at) const {
    return T(3) * per_sigma * slope_shape(at);
  }
  template <class V>
  [[gnu::always_inline]] V slope_shape_derivative(const Ends<V>& at) const {
    return T(2) * per_sigma * (with_sign_flipped<V>(at.near, at.near_end) - at.far);
  }
  T value(T r) const { return value_scale * value_shape(ends(r)); }
  T slope(T r) const { return slope_scale * slope_shape(ends(r)); }
  T slope_derivative(T r) const { return slope_scale * slope_shape_derivative(ends(r)); }

  T value_gram(T r) const {
    const auto second = [this](T at) {  // antiderivative of the antiderivative of k0, divided by mass
      const T q = positive_part(T(1) - std::abs(at) * per_sigma);
      return std::abs(at) / 2 - sigma / 8 * (1 - q * q * q * q);
    };
    return second_difference(r, second);
  }
  T cross_gram(T r) const {
    return sigma * second_difference(r, [this](T at) {  // antiderivative of k0, divided by mass
             const T q = positive_part(T(1) - std::abs(at) * per_sigma);
             return std::copysign((1 - q * q * q) / 2, at);
           });
  }
  T slope_gram(T r) const {
    return -T(1.5) * sigma * second_difference(r, [this](T at) {
      const T q = positive_part(T(1) - std::abs(at) * per_sigma);
      return q * q;
    });
  }

 private:
  template <class Function>
  T second_difference(T r, Function&& f) const {
    const T h = 2 * half;
    return (f(r + h) - 2 * f(r) + f(r - h)) / (h * h);
  }
};

}  // namespace saltus
