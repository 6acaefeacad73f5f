#pragma once

#include "core/grid/lattice.h"

namespace saltus {

/// out_i = sum of in_j over |j - i| <= radius, cut at the ends, of `length` rows of `width` values side by side; rows
/// are `in_stride` and `out_stride` values apart. By running sums in double, from the first row to the last: the cost
/// does not depend on the radius. Boxes of up to five rows are summed anew. `in` and `out` must not overlap.
template <class T>
void box_sum_rows(int length, int radius, std::size_t width, const T* in, std::size_t in_stride, T* out,
                  std::size_t out_stride);

/// Sums over boxes [i - radius, i + radius] per axis, cut at the lattice's border, of an interleaved field, as
/// box_sum_rows makes them. The box is symmetric, so this is its own transpose.
template <int Dim, class T>
class BoxSum {
 public:
  BoxSum(const Lattice<Dim>& lattice, const Index<Dim>& radius) : lattice_(lattice), radius_(radius) {}

  /// In place: memory sees the field twice. Threads share it out; sums do not depend on how many there are.
  void apply(int channels, T* field) const;

 private:
  Lattice<Dim> lattice_;
  Index<Dim> radius_;
};

}  // namespace saltus
