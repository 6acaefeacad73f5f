#pragma once

#include "core/grid/lattice.h"

#include <cmath>

namespace saltus {

/// Derivative along an axis from its two one-sided differences, leaning to the smaller one where they disagree:
///
///     g = l f + (1 - l) b,   l = wf / (wf + wb),   w = (tolerance + |difference|^2)^-2
///
/// Where the map is smooth f and b agree and g is the central difference, second order. Across a jump one of them is of
/// order 1/h and is left out: the flow next to a sliding interface is differentiated on its own side only. Smooth in
/// its arguments, so it has an exact adjoint. The differences are strains, without unit, so the tolerance needs none.
constexpr double kStrainTolerance = 0.01;

/// Weight l of the forward difference. N values a difference.
template <int N, class T>
inline T forward_weight(const T* forward, const T* backward) {
  T f2 = T(kStrainTolerance), b2 = T(kStrainTolerance);
  for (int n = 0; n < N; ++n) {
    f2 += forward[n] * forward[n];
    b2 += backward[n] * backward[n];
  }
  return b2 * b2 / (f2 * f2 + b2 * b2);
}

/// Adjoint: adds to forward_dual and backward_dual what `dual` of g makes of them.
template <int N, class T>
inline void side_difference_adjoint(const T* forward, const T* backward, const T* dual, T* forward_dual,
                                    T* backward_dual) {
  T f2 = T(kStrainTolerance), b2 = T(kStrainTolerance), along = 0;
  for (int n = 0; n < N; ++n) {
    f2 += forward[n] * forward[n];
    b2 += backward[n] * backward[n];
    along += (forward[n] - backward[n]) * dual[n];
  }
  const T l = b2 * b2 / (f2 * f2 + b2 * b2);
  const T slope = l * (1 - l) * along * 4;
  for (int n = 0; n < N; ++n) {
    forward_dual[n] += l * dual[n] - slope * forward[n] / f2;
    backward_dual[n] += (1 - l) * dual[n] + slope * backward[n] / b2;
  }
}

/// The two one-sided differences of an interleaved field of N values along one axis at a site, each times `scale`.
/// At the border the one that does not exist is a copy of the other; both are 0 on an axis of one sample.
template <int N, int Dim, class T>
struct SideDifferences {
  T forward[N], backward[N];
  bool has_forward, has_backward;

  SideDifferences(const Lattice<Dim>& lattice, const Index<Dim>& index, std::size_t site, std::size_t stride, int axis,
                  const T* field, T scale) {
    has_forward = index[axis] + 1 < lattice.size[axis];
    has_backward = index[axis] > 0;
    const T* at = field + N * site;
    for (int n = 0; n < N; ++n) {
      forward[n] = has_forward ? (at[n + N * stride] - at[n]) * scale : T(0);
      backward[n] = has_backward ? (at[n] - *(at + n - N * stride)) * scale : T(0);
      if (!has_forward) forward[n] = backward[n];
      if (!has_backward) backward[n] = forward[n];
    }
  }

  void combine(T* result) const {
    const T l = forward_weight<N, T>(forward, backward);
    for (int n = 0; n < N; ++n) result[n] = l * forward[n] + (1 - l) * backward[n];
  }

  /// Adds the adjoint of combine (and of the differences) to field_dual.
  void adjoint(const T* dual, std::size_t site, std::size_t stride, T scale, T* field_dual) const {
    if (!has_forward && !has_backward) return;
    T forward_dual[N] = {}, backward_dual[N] = {};
    side_difference_adjoint<N, T>(forward, backward, dual, forward_dual, backward_dual);
    T* at = field_dual + N * site;
    for (int n = 0; n < N; ++n) {
      T f = forward_dual[n], b = backward_dual[n];
      if (!has_forward) b += f, f = 0;
      if (!has_backward) f += b, b = 0;
      at[n] += scale * (b - f);
      if (has_forward) at[n + N * stride] += scale * f;
      if (has_backward) *(at + n - N * stride) -= scale * b;
    }
  }
};

}  // namespace saltus
