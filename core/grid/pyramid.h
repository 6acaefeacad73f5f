#pragma once

#include "core/grid/lattice.h"

namespace saltus {

/// Samples of `lattice`, smoothed along each axis with a Gaussian (the border's value continues), then read linearly at
/// the sites of `target`. The standard deviation is `smoothing` target samples, and at least half a target sample along
/// axes that get coarser.
template <int Dim, class T>
std::vector<T> downsampled(const Lattice<Dim>& lattice, const std::vector<T>& samples, const Lattice<Dim>& target,
                           double smoothing = 0);

}  // namespace saltus
