#pragma once

#include "core/grid/lattice.h"

namespace saltus {

enum class Combine { Replace, Add };

/// out[.., i, ..] (+)= sum_j tap[j + radius] in[.., i - j, ..] along one axis of an interleaved field; what lies
/// outside the lattice is 0. `in` and `out` must not overlap. Direct: 2 radius + 1 multiplications a value; threads
/// over lines.
template <int Dim, class T>
void convolve_axis(const Lattice<Dim>& lattice, int channels, int axis, const std::vector<T>& taps, Combine combine,
                   const T* in, T* out);

}  // namespace saltus
