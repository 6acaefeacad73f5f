#include "core/kernels/separable_convolution.h"

#include "core/kernels/block_columns.h"
#include "core/kernels/direct_lines.h"
#include "core/kernels/line_strips.h"
#include "core/kernels/sliding_moments.h"
#include "core/support/registers.h"

namespace saltus {
namespace {

/// The shortest runs for which moments are faster, along x, y and z. Measured with
/// tests/benchmark/convolution_benchmark.cpp: 96^3 sites, 3 channels, float; ns a value of rows with runs of 6, 12, 20
/// and 64 samples tap by tap along x 0.55, 0.8, 1.1, 2.8, y 0.45, 0.6, 0.75, 1.7, z 0.5, 0.6, 0.75, 1.6; by moments
/// 1.1, 0.75 to 0.85 and 1.0 at all of them. Registers of half the size take tap by tap 0.65, 1.0, 1.5, 4.3 along x,
/// 0.8, 0.95, 1.3, 4.3 along the others.
constexpr std::array<int, 3> kShortestRun =
    kRegisterBytes == 64 ? std::array<int, 3>{24, 24, 40} : std::array<int, 3>{18, 10, 16};
/// The same where blocks are copied into columns first, whatever the axis.
constexpr int kShortestRunOfBlocks = 5;

template <class T>
std::vector<std::pair<int, T>> numbered(const std::vector<T>& taps) {
  const int radius = static_cast<int>(taps.size() / 2);
  std::vector<std::pair<int, T>> result;
  for (int t = -radius; t <= radius; ++t) result.push_back({t, taps[static_cast<std::size_t>(t + radius)]});
  return result;
}

template <class T>
bool uses_moments(const AxisTaps<T>& taps, int shortest_run) {
  if (!taps.has_runs() || taps.method == ConvolutionMethod::Direct) return false;
  return taps.method == ConvolutionMethod::Moments || taps.length >= shortest_run;
}

}  // namespace

template <int Dim, class T>
void convolve_axis(const Lattice<Dim>& lattice, int channels, int axis, const std::vector<T>& taps, Combine combine,
                   const T* in, T* out) {
  convolve_axis_directly<Dim, T>(lattice, channels, axis, taps, combine, in, out);
}

template <int Dim, class T>
void convolve_axis(const Lattice<Dim>& lattice, int channels, int axis, const AxisTaps<T>& taps, Combine combine,
                   const T* in, T* out) {
  if (uses_moments(taps, kShortestRun[static_cast<std::size_t>(axis)]))
    convolve_axis_by_moments<Dim, T>(lattice, channels, axis, taps, combine, in, out);
  else
    convolve_axis<Dim, T>(lattice, channels, axis, taps.direct, combine, in, out);
}

template <int Dim, class T>
void convolve_axis(const Lattice<Dim>& lattice, int axis, const AxisTaps<T>& taps, Combine combine,
                   const BlockMask<Dim>& in_at, const T* in, const BlockMask<Dim>& out_at, T* out) {
  if (in_at.is_all() && out_at.is_all()) return convolve_axis<Dim, T>(lattice, Dim, axis, taps, combine, in, out);
  if (out_at.is_empty()) return;
  if (uses_moments(taps, kShortestRunOfBlocks)) {
    for_block_columns<Dim, T>(
        lattice, axis, taps.radius(), combine, in_at, in, out_at, out,
        [&](int count, const T* source, T* target) { add_by_moments<kColumnLanes<Dim>>(taps, count, source, target); });
  } else {
    const auto rows = numbered(taps.direct);
    for_block_columns<Dim, T>(
        lattice, axis, taps.radius(), combine, in_at, in, out_at, out,
        [&](int count, const T* source, T* target) { add_taps<kColumnLanes<Dim>>(rows, count, source, target); });
  }
}

#define SALTUS_CONVOLVE(DIM, T)                                                                                     \
  template void convolve_axis<DIM, T>(const Lattice<DIM>&, int, int, const std::vector<T>&, Combine, const T*, T*); \
  template void convolve_axis<DIM, T>(const Lattice<DIM>&, int, int, const AxisTaps<T>&, Combine, const T*, T*);    \
  template void convolve_axis<DIM, T>(const Lattice<DIM>&, int, const AxisTaps<T>&, Combine, const BlockMask<DIM>&, \
                                      const T*, const BlockMask<DIM>&, T*);
SALTUS_CONVOLVE(2, float)
SALTUS_CONVOLVE(3, float)
SALTUS_CONVOLVE(2, double)
SALTUS_CONVOLVE(3, double)
#undef SALTUS_CONVOLVE

}  // namespace saltus
