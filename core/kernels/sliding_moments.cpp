#include "core/kernels/sliding_moments.h"

#include "core/kernels/block_columns.h"
#include "core/kernels/line_strips.h"

#include <algorithm>

namespace saltus {
namespace {

/// Moments about a block border, of all lanes.
template <int Degree, int Lanes, class T>
struct Moments {
  T sum[Degree + 1][Lanes] = {};

  void take(int k, const T* x) {
    const T k1 = static_cast<T>(k), k2 = k1 * k1;
#pragma omp simd
    for (int lane = 0; lane < Lanes; ++lane) {
      sum[0][lane] += x[lane];
      if constexpr (Degree > 0) sum[1][lane] += k1 * x[lane];
      if constexpr (Degree > 1) sum[2][lane] += k2 * x[lane];
    }
  }

  void give(T at, T slope, T half_curvature, T* out) const {
#pragma omp simd
    for (int lane = 0; lane < Lanes; ++lane) {
      T value = at * sum[0][lane];
      if constexpr (Degree > 0) value += slope * sum[1][lane];
      if constexpr (Degree > 1) value += half_curvature * sum[2][lane];
      out[lane] += value;
    }
  }
};

/// Adds both runs to `count` rows of lanes.
template <int Degree, int Lanes, class T>
void add_runs(const AxisTaps<T>& taps, int count, const T* in, T* out) {
  const int length = taps.length;
  const auto is_inside = [count](int i) { return i >= 0 && i < count; };
  for (int begin = 0; begin < count; begin += length) {
    const int end = begin + length;
    Moments<Degree, Lanes, T> before_end;  // windows that begin in this block: their part up to its end
    for (int j = std::min(end, count) - 1; j >= begin; --j) {
      before_end.take(end - j, in + j * Lanes);
      for (const auto& p : taps.polynomials)
        if (const int i = j + p.run.last; is_inside(i))
          before_end.give(p.at[j - begin], p.slope[j - begin], p.half_curvature, out + i * Lanes);
    }
    Moments<Degree, Lanes, T> after_begin;  // windows that began in the block before: their part from here on
    for (int j = begin; j < end - 1; ++j) {
      if (j < count) after_begin.take(j - begin, in + j * Lanes);
      for (const auto& p : taps.polynomials)
        if (const int i = j + p.run.first; is_inside(i))
          after_begin.give(p.at[j - begin + 1], -p.slope[j - begin + 1], p.half_curvature, out + i * Lanes);
    }
  }
}

}  // namespace

template <int Lanes, class T>
void add_by_moments(const AxisTaps<T>& taps, int count, const T* in, T* out) {
  add_taps<Lanes>(taps.singles, count, in, out);
  if (!taps.has_runs()) return;
  switch (taps.degree) {
    case 0:
      return add_runs<0, Lanes>(taps, count, in, out);
    case 1:
      return add_runs<1, Lanes>(taps, count, in, out);
    default:
      return add_runs<2, Lanes>(taps, count, in, out);
  }
}

template <int Dim, class T>
void convolve_axis_by_moments(const Lattice<Dim>& lattice, int channels, int axis, const AxisTaps<T>& taps,
                              Combine combine, const T* in, T* out) {
  for_line_strips<Dim, T>(
      lattice, channels, axis, taps.radius(), combine, in, out,
      [&](int count, const T* source, T* target) { add_by_moments<kLanes<T>>(taps, count, source, target); });
}

template void convolve_axis_by_moments<2, float>(const Lattice<2>&, int, int, const AxisTaps<float>&, Combine,
                                                 const float*, float*);
template void convolve_axis_by_moments<3, float>(const Lattice<3>&, int, int, const AxisTaps<float>&, Combine,
                                                 const float*, float*);
template void convolve_axis_by_moments<2, double>(const Lattice<2>&, int, int, const AxisTaps<double>&, Combine,
                                                  const double*, double*);
template void convolve_axis_by_moments<3, double>(const Lattice<3>&, int, int, const AxisTaps<double>&, Combine,
                                                  const double*, double*);

template void add_by_moments<kColumnLanes<2>, float>(const AxisTaps<float>&, int, const float*, float*);
template void add_by_moments<kColumnLanes<3>, float>(const AxisTaps<float>&, int, const float*, float*);
template void add_by_moments<kColumnLanes<2>, double>(const AxisTaps<double>&, int, const double*, double*);
template void add_by_moments<kColumnLanes<3>, double>(const AxisTaps<double>&, int, const double*, double*);

}  // namespace saltus
