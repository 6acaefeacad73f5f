#pragma once

#include "core/grid/lattice.h"

namespace saltus {

/// Sums over boxes [i - radius, i + radius] per axis, cut at the lattice's border, of an interleaved field. By running
/// sums in double, from the first value of a line to the last: the cost does not depend on the radius. Boxes of up to
/// five values along an axis are summed anew. The box is symmetric, so this is its own transpose.
template <int Dim, class T>
class BoxSum {
 public:
  BoxSum(const Lattice<Dim>& lattice, const Index<Dim>& radius) : lattice_(lattice), radius_(radius) {}

  /// In place: where the second cache holds a plane, memory sees the field twice. Threads share it out; sums do not
  /// depend on how many there are.
  void apply(int channels, T* field) const;

 private:
  Lattice<Dim> lattice_;
  Index<Dim> radius_;
};

}  // namespace saltus
