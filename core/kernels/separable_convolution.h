#pragma once

#include "core/grid/block_mask.h"
#include "core/grid/lattice.h"
#include "core/kernels/axis_taps.h"

namespace saltus {

enum class Combine { Replace, Add };

/// out[.., i, ..] (+)= sum_j tap[j] in[.., i - j, ..] along one axis of an interleaved field; what lies outside the
/// lattice is 0. `in` and `out` must not overlap, but may be one field where the row is its own mirror image
/// (std::logic_error where it is not): then memory sees one field instead of two. One product and two sums for two taps
/// that mirror each other; threads over strips of lines, each value summed in one order.
template <int Dim, class T>
void convolve_axis(const Lattice<Dim>& lattice, int channels, int axis, const AxisTaps<T>& taps, Combine combine,
                   const T* in, T* out);

/// The same for fields with Dim channels that are worth something in blocks only: `in` is 0 outside `in_at`, whatever
/// stands there, and `out` is written in `out_at` only. Costs what is in the masks. Everything the row makes of `in`
/// need not be in `out_at`; with all blocks in both this is the call above.
template <int Dim, class T>
void convolve_axis(const Lattice<Dim>& lattice, int axis, const AxisTaps<T>& taps, Combine combine,
                   const BlockMask<Dim>& in_at, const T* in, const BlockMask<Dim>& out_at, T* out);

/// convolve_axis along y and then x, to the bit, one plane or a few at a time: what y makes of them stays in a thread's
/// cache until x has made their result of it, so that a field goes through memory once. `out` may be `in`.
template <class T>
void convolve_planes(const Lattice<3>& lattice, int channels, const AxisTaps<T>& along_y, const AxisTaps<T>& along_x,
                     Combine combine, const T* in, T* out);

}  // namespace saltus
