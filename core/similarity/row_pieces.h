#pragma once

#include "core/grid/lattice.h"
#include "core/support/thread_count.h"

#include <algorithm>
#include <vector>

namespace saltus {

/// Samples that follow each other along x. Similarities go through a lattice in such pieces: their loops run in lanes,
/// and what lies between two of them stays in the nearest cache.
template <int Dim>
struct RowPiece {
  Index<Dim> first;  ///< the first sample
  std::size_t site;  ///< its number
  int length;
};
constexpr int kLongestPiece = 128;

/// Sum of term(piece) over the lattice, slabs of the last axis in parallel, in an order that does not depend on the
/// number of threads.
template <int Dim, class Term>
double sum_of_pieces(const Lattice<Dim>& lattice, Term&& term) {
  const Index<Dim>& size = lattice.size;
  const int rows = Dim == 3 ? size[1] : 1, slabs = size[Dim - 1];
  std::vector<double> sums(static_cast<std::size_t>(slabs));
#pragma omp parallel for schedule(static) if (is_worth_threads(lattice.sites()))
  for (int slab = 0; slab < slabs; ++slab) {
    double sum = 0;
    for (int row = 0; row < rows; ++row)
      for (int x = 0; x < size[0]; x += kLongestPiece) {
        RowPiece<Dim> piece{{}, 0, std::min(kLongestPiece, size[0] - x)};
        piece.first[Dim - 1] = slab;
        if (Dim == 3) piece.first[1] = row;
        piece.first[0] = x;
        for (int axis = Dim - 1; axis >= 0; --axis)
          piece.site = piece.site * static_cast<std::size_t>(size[axis]) + static_cast<std::size_t>(piece.first[axis]);
        sum += term(static_cast<const RowPiece<Dim>&>(piece));
      }
    sums[static_cast<std::size_t>(slab)] = sum;
  }
  double sum = 0;
  for (double part : sums) sum += part;
  return sum;
}

}  // namespace saltus
