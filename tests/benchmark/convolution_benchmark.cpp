// Nanoseconds a value of one convolution along x, y or z, taken tap by tap and by sliding moments, for a range of
// widths of the C0 Wendland kernel: where the two cross decides which one convolve_axis takes.
//   OMP_NUM_THREADS=1 convolution_benchmark [values a side of the cube, default 96]
#include "core/kernels/separable_convolution.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>

namespace {

using namespace saltus;
using Clock = std::chrono::steady_clock;

/// Best of some repetitions, ns a value.
double nanoseconds(const Lattice<3>& lattice, int axis, const AxisTaps<float>& taps, const std::vector<float>& in,
                   std::vector<float>& out) {
  double best = 1e300;
  for (int repetition = 0; repetition < 5; ++repetition) {
    const auto start = Clock::now();
    convolve_axis<3, float>(lattice, 3, axis, taps, Combine::Replace, in.data(), out.data());
    const std::chrono::duration<double, std::nano> taken = Clock::now() - start;
    best = std::min(best, taken.count() / static_cast<double>(in.size()));
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
  return 0;
}
