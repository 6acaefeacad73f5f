#pragma once

#include "core/grid/lattice.h"

#include <Eigen/Core>

#include <array>

namespace saltus {

/// Calls visit(site, D v) for each site of a slab (the last axis' index), with component c along axis a in row c,
/// column a. `velocity` is interleaved, on `lattice`; differences are central, one-sided at the border, 0 along an axis
/// of one sample.
template <int Dim, class T, class Visit>
void visit_derivatives(const Lattice<Dim>& lattice, const Field<T>& velocity, int slab, Visit&& visit) {
  std::array<std::size_t, Dim> strides;
  std::size_t stride = 1;
  for (int a = 0; a < Dim; ++a) {
    strides[a] = stride;
    stride *= static_cast<std::size_t>(lattice.size[a]);
  }
  visit_slab<Dim>(lattice, slab, [&](const Index<Dim>& index, std::size_t site) {
    Eigen::Matrix<T, Dim, Dim> derivative = Eigen::Matrix<T, Dim, Dim>::Zero();
    for (int a = 0; a < Dim; ++a) {
      const bool has_above = index[a] + 1 < lattice.size[a], has_below = index[a] > 0;
      const T span = static_cast<T>((has_above + has_below) * lattice.spacing[a]);
      if (span == T(0)) continue;
      const T* above = velocity.data() + Dim * (has_above ? site + strides[a] : site);
      const T* below = velocity.data() + Dim * (has_below ? site - strides[a] : site);
      for (int c = 0; c < Dim; ++c) derivative(c, a) = (above[c] - below[c]) / span;
    }
    visit(site, derivative);
  });
}

}  // namespace saltus
