#pragma once

#include "core/grid/lattice.h"

namespace saltus::testing {

/// A lattice of `size` sites with a spacing of 1 mm.
template <int Dim>
Lattice<Dim> unit_lattice(const Index<Dim>& size) {
  Lattice<Dim> lattice;
  lattice.size = size;
  lattice.spacing.fill(1);
  return lattice;
}

}  // namespace saltus::testing
