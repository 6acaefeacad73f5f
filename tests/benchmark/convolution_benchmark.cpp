// Nanoseconds a value of one convolution along x, y or z, taken tap by tap and by sliding moments, for a range of
// widths of the C0 Wendland kernel: where the two cross decides which one convolve_axis takes.
//   OMP_NUM_THREADS=1 convolution_benchmark [values a side of the cube, default 96]
#include "core/kernels/separable_convolution.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>

namespace {

using namespace saltus;

/// Best of some repetitions, ns a value.
double nanoseconds(const Lattice<3>& lattice, int axis, const AxisTaps<float>& taps, const std::vector<float>& in,
                   std::vector<float>& out) {
  double best = 1e300;
  for (int repetition = 0; repetition < 9; ++repetition) {
    const std::clock_t start = std::clock();  // of the processor: a busy machine disturbs it less
    convolve_axis<3, float>(lattice, 3, axis, taps, Combine::Replace, in.data(), out.data());
    const double taken = 1e9 * static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
    best = std::min(best, taken / static_cast<double>(in.size()));
  }
  return best;
}

}  // namespace

int main(int count, char** words) {
  const int side = count > 1 ? std::atoi(words[1]) : 96;
  if (side < 2 || side > 512) {
    std::fprintf(stderr, "the side of the cube is '%s'; give a number from 2 to 512\n", words[1]);
    return 1;
  }
  const Lattice<3> lattice{{side, side, side}, {1, 1, 1}, {}};
  std::vector<float> in(3 * lattice.sites()), out(in.size());
  for (std::size_t i = 0; i < in.size(); ++i) in[i] = static_cast<float>(i * 2654435761u % 1024) / 1024 - 0.5f;
  std::printf("%d^3 sites, 3 channels, float; ns a value: direct / moments\n", side);
  std::printf("%-6s%-12s%16s%16s%16s\n", "sigma", "taps", "x", "y", "z");
  for (double sigma : {3.0, 4.0, 6.0, 8.0, 10.0, 12.0, 16.0, 20.0, 24.0, 32.0, 48.0, 64.0}) {
    const KernelTaps taps = cell_averaged_taps(*make_wendland_profile(sigma), 1.0);
    const auto row = [&](const char* name, const std::vector<double>& all, const std::array<TapRun, 2>& runs,
                         int degree) {
      std::printf("%-6g%-12s", sigma, name);
      for (int axis = 0; axis < 3; ++axis) {
        const double direct =
            nanoseconds(lattice, axis, AxisTaps<float>(all, runs, degree, ConvolutionMethod::Direct), in, out);
        const double moments =
            nanoseconds(lattice, axis, AxisTaps<float>(all, runs, degree, ConvolutionMethod::Moments), in, out);
        std::printf("%8.2f /%6.2f", direct, moments);
      }
      std::printf("\n");
    };
    row("value", taps.value, taps.value_runs, taps.degree);
    row("slope", taps.slope, taps.slope_runs, taps.degree - 1);
    row("curvature", taps.curvature, taps.curvature_runs, taps.degree - 2);
  }

  // First-order momenta are 0 nearly everywhere: the same along each axis for a field that is not 0 in two planes only.
  const KernelTaps taps = cell_averaged_taps(*make_wendland_profile(6), 1.0);
  const AxisTaps<float> slope(taps.slope, taps.slope_runs, taps.degree - 1);
  std::printf("slope of width 6, ns a value, of a dense field and of two planes across x, y, z\n");
  for (int plane = -1; plane < 3; ++plane) {
    if (plane >= 0) {
      std::fill(in.begin(), in.end(), 0.0f);
      std::size_t stride = 3;
      for (int a = 0; a < plane; ++a) stride *= static_cast<std::size_t>(side);
      for (std::size_t i = 0; i < in.size(); ++i)
        if (const std::size_t at = i / stride % side; at == std::size_t(side) / 2 || at == std::size_t(side) / 2 + 1)
          in[i] = 0.3f;
    }
    std::printf("%-8s", plane < 0 ? "dense" : plane == 0 ? "x" : plane == 1 ? "y" : "z");
    for (int axis = 0; axis < 3; ++axis) std::printf("%16.2f", nanoseconds(lattice, axis, slope, in, out));
    std::printf("\n");
  }
  return 0;
}
