#include "core/kernels/separable_convolution.h"

#include "core/kernels/line_strips.h"
#include "core/kernels/sliding_moments.h"

namespace saltus {
namespace {

/// The shortest runs for which moments are faster, for rows of degree 0, 1 and 2, about alike for all axes. Measured
/// with tests/benchmark/convolution_benchmark.cpp: 96^3 sites, 3 channels, float; at runs of 5 samples a value takes
/// 1.1 to 1.4 ns either way, at 31 samples 2.4 to 2.9 ns tap by tap and 1.0 to 1.4 ns by moments.
constexpr int kShortestRun[3] = {5, 4, 6};

template <class T>
bool uses_moments(const AxisTaps<T>& taps) {
  if (!taps.has_runs() || taps.method == ConvolutionMethod::Direct) return false;
  return taps.method == ConvolutionMethod::Moments || taps.length >= kShortestRun[taps.degree];
}

}  // namespace

template <int Dim, class T>
void convolve_axis(const Lattice<Dim>& lattice, int channels, int axis, const std::vector<T>& taps, Combine combine,
                   const T* in, T* out) {
  const int radius = static_cast<int>(taps.size() / 2);
  std::vector<std::pair<int, T>> numbered;
  for (int t = -radius; t <= radius; ++t) numbered.push_back({t, taps[static_cast<std::size_t>(t + radius)]});
  for_line_strips<Dim, T>(lattice, channels, axis, radius, combine, in, out,
                          [&](int count, const T* source, T* target) { add_taps(numbered, count, source, target); });
}

template <int Dim, class T>
void convolve_axis(const Lattice<Dim>& lattice, int channels, int axis, const AxisTaps<T>& taps, Combine combine,
                   const T* in, T* out) {
  if (uses_moments(taps))
    convolve_axis_by_moments<Dim, T>(lattice, channels, axis, taps, combine, in, out);
  else
    convolve_axis<Dim, T>(lattice, channels, axis, taps.direct, combine, in, out);
}

#define SALTUS_CONVOLVE(DIM, T)                                                                                     \
  template void convolve_axis<DIM, T>(const Lattice<DIM>&, int, int, const std::vector<T>&, Combine, const T*, T*); \
  template void convolve_axis<DIM, T>(const Lattice<DIM>&, int, int, const AxisTaps<T>&, Combine, const T*, T*);
SALTUS_CONVOLVE(2, float)
SALTUS_CONVOLVE(3, float)
SALTUS_CONVOLVE(2, double)
SALTUS_CONVOLVE(3, double)
#undef SALTUS_CONVOLVE

}  // namespace saltus
