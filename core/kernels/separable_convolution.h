#pragma once

#include "core/grid/lattice.h"
#include "core/kernels/axis_taps.h"

namespace saltus {

enum class Combine { Replace, Add };

/// out[.., i, ..] (+)= sum_j tap[j + radius] in[.., i - j, ..] along one axis of an interleaved field; what lies
/// outside the lattice is 0. `in` and `out` must not overlap. Direct: 2 radius + 1 multiplications a value; threads
/// over strips of lines, each value summed in the order of its taps.
template <int Dim, class T>
void convolve_axis(const Lattice<Dim>& lattice, int channels, int axis, const std::vector<T>& taps, Combine combine,
                   const T* in, T* out);

/// The same, by the method that `taps` asks for: directly, or by sliding moments (sliding_moments.h) at a cost that
/// does not depend on the radius.
template <int Dim, class T>
void convolve_axis(const Lattice<Dim>& lattice, int channels, int axis, const AxisTaps<T>& taps, Combine combine,
                   const T* in, T* out);

}  // namespace saltus
