#pragma once

#include "core/grid/block_mask.h"
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

/// The same for fields with Dim channels that are worth something in blocks only: `in` is 0 outside `in_at`, whatever
/// stands there, and `out` is written in `out_at` only. Costs what is in the masks. Everything the row makes of `in`
/// need not be in `out_at`; with all blocks in both this is the call above.
template <int Dim, class T>
void convolve_axis(const Lattice<Dim>& lattice, int axis, const AxisTaps<T>& taps, Combine combine,
                   const BlockMask<Dim>& in_at, const T* in, const BlockMask<Dim>& out_at, T* out);

}  // namespace saltus
