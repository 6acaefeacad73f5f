#pragma once

#include "core/grid/lattice.h"

namespace saltus {

/// Samples of `lattice`, smoothed along each axis with a Gaussian of standard deviation half the target spacing (where
/// the target is coarser; the border's value continues), then read linearly at the sites of `target`.
template <int Dim, class T>
std::vector<T> downsampled(const Lattice<Dim>& lattice, const std::vector<T>& samples, const Lattice<Dim>& target);

}  // namespace saltus
