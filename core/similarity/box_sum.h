#pragma once

#include "core/grid/lattice.h"

#include <cstddef>

namespace saltus {

/// Bytes that a thread copies at a time, unless lines have more than 4096 values (then 64 for each).
constexpr std::size_t kBoxSumCopy = 256 << 10;

/// Sums over boxes [i - radius, i + radius] per axis, cut at the lattice's border, of a field. By running
/// sums in double, from the first value of a line to the last: the cost does not depend on the radius. Boxes of up to
/// five values along an axis are summed anew. The box is symmetric, so this is its own transpose.
template <int Dim, class T>
class BoxSum {
 public:
  BoxSum(const Lattice<Dim>& lattice, const Index<Dim>& radius) : lattice_(lattice), radius_(radius) {}

  /// In place: memory sees the field twice, or three times where planes are too few for the threads, or too large for
  /// the second cache. Sums do not depend on the number of threads.
  void apply(T* field) const;

 private:
  Lattice<Dim> lattice_;
  Index<Dim> radius_;
};

}  // namespace saltus
