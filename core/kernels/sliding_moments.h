#pragma once

#include "core/grid/lattice.h"
#include "core/kernels/axis_taps.h"
#include "core/kernels/separable_convolution.h"

namespace saltus {

/// What convolve_axis does, at a cost that does not depend on how long the runs of the taps are.
///
/// A run of length L is a window that slides along the line. The line is cut into blocks of L samples, so a window is
/// the end of one block and the beginning of the next. With k the distance from the block border,
///
///     sum over the window of p(i - j) x_j = sum over q of p^(q)(i - border) / q! sum over the window of (+-k)^q x_j,
///
/// and the moments sum k^q x_j, q = 0..2, grow sample by sample from the border outwards. Nothing is ever taken off a
/// sum again, so no error is carried along the line: a value is off by at most about 4 (L + 4) epsilon times the sum of
/// |tap| |x| of its own window, as if the window had been summed directly. Both runs of a row share their moments.
///
/// Lines run side by side in strips, copied into cache first; a strip belongs to one thread.
template <int Dim, class T>
void convolve_axis_by_moments(const Lattice<Dim>& lattice, int channels, int axis, const AxisTaps<T>& taps,
                              Combine combine, const T* in, T* out);

/// The same for `count` rows of `Lanes` values each: adds to `out`. For kLanes<T> and kColumnLanes<Dim>.
template <int Lanes, class T>
void add_by_moments(const AxisTaps<T>& taps, int count, const T* in, T* out);

}  // namespace saltus
