#pragma once

#include "core/kernels/kernel_profile.h"

#include <array>
#include <utility>
#include <vector>

namespace saltus {

/// How a row of taps is applied.
enum class ConvolutionMethod {
  Fastest,  ///< moments where the row has runs that are long enough to gain, see separable_convolution.cpp
  Direct,   ///< every tap by itself
  Moments,  ///< runs by sliding moments, the other taps by themselves; direct where there are no runs
};

/// One row of taps, ready to be applied along an axis: all taps, and, where two runs of them are polynomials of degree
/// up to 2, those polynomials.
template <class T>
struct AxisTaps {
  /// p(t) = sum of taps: at[k] and slope[k] are p and p' at t = run.first - 1 + k, k = 0..length; p'' is constant.
  struct Polynomial {
    TapRun run;
    std::vector<T> at, slope;
    T half_curvature = 0;
  };

  /// `taps` for t = -radius..radius. Runs that are empty, unequal or of a degree above 2 are ignored.
  AxisTaps(const std::vector<double>& taps, const std::array<TapRun, 2>& runs, int degree,
           ConvolutionMethod method = ConvolutionMethod::Fastest);
  /// Without runs.
  explicit AxisTaps(const std::vector<double>& taps) : AxisTaps(taps, {}, -1) {}

  int radius() const { return static_cast<int>(direct.size() / 2); }
  bool has_runs() const { return length > 0; }

  std::vector<T> direct;  ///< [t + radius]
  ConvolutionMethod method;
  int degree = -1;
  int length = 0;  ///< of both runs; 0: there are none
  std::array<Polynomial, 2> polynomials;
  std::vector<std::pair<int, T>> singles;  ///< (t, tap) of what is in no run and not 0
};

std::vector<double> scaled(std::vector<double> taps, double factor);

/// The row of the transposed convolution: tap t is the old tap -t.
std::vector<double> reversed(const std::vector<double>& taps);
std::array<TapRun, 2> reversed(const std::array<TapRun, 2>& runs);

}  // namespace saltus
