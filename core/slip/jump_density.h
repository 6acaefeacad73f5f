#pragma once

#include "core/slip/jump_elements.h"

#include <optional>
#include <vector>

namespace saltus {

/// The singular part of D v, smoothed: B = G * sum over elements of [v] n^T delta, each on the plane that its kernel
/// covers, with G a Gaussian of kSmoothing samples' standard deviation along each axis. Elements of opposite jump
/// cancel, steps of a staircase add up to its slope, and where momenta are sparse their kernels join: of a sheet that
/// jumps by J across n, B is J n^T times the profile of G across it, however it is made. Lives on the finest lattice
/// that has elements, cropped to where they reach and to that lattice's cells.
template <int Dim>
class JumpDensity {
 public:
  static constexpr double kSmoothing = 2;

  /// Throws InvalidInput when no list has an element.
  explicit JumpDensity(const std::vector<JumpElements<Dim>>& elements);

  const Lattice<Dim>& lattice() const { return lattice_; }
  /// B, row by row (component of the jump, then of the normal), interleaved.
  const std::vector<float>& values() const { return values_; }
  double smoothing_along(const Vector<Dim>& direction) const;  ///< standard deviation of G, mm
  /// [v] of the sheet at x with unit normal n: the integral of B n along n.
  Vector<Dim> jump_across(const Vector<Dim>& x, const Vector<Dim>& n) const;

 private:
  Lattice<Dim> lattice_;
  std::vector<float> values_;
};

}  // namespace saltus
