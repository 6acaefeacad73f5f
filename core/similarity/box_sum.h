#pragma once

#include "core/grid/lattice.h"

namespace saltus {

/// Sums over boxes [i - radius, i + radius] per axis, cut at the lattice's border, of an interleaved field, by running
/// sums: the cost does not depend on the radius. The box is symmetric, so this is its own transpose.
template <int Dim, class T>
class BoxSum {
 public:
  BoxSum(const Lattice<Dim>& lattice, const Index<Dim>& radius) : lattice_(lattice), radius_(radius) {}

  /// In place.
  void apply(int channels, T* field);

 private:
  Lattice<Dim> lattice_;
  Index<Dim> radius_;
  std::vector<T> scratch_;
};

}  // namespace saltus
