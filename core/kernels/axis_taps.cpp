#include "core/kernels/axis_taps.h"

#include <algorithm>

namespace saltus {
namespace {

/// c[0] + c[1] (t - middle) + c[2] (t - middle)^2 through the ends and the middle of a run.
struct Parabola {
  double middle = 0, c[3] = {};

  template <class Tap>
  Parabola(const TapRun& run, int degree, Tap&& tap) {
    const int centre = (run.first + run.last) / 2;
    middle = centre;
    c[0] = tap(centre);
    if (degree < 1) return;
    const double below = run.first - centre, above = run.last - centre;
    if (degree < 2) {
      c[1] = (tap(run.last) - tap(run.first)) / (above - below);
      return;
    }
    const double slope_below = (tap(run.first) - c[0]) / below, slope_above = (tap(run.last) - c[0]) / above;
    c[2] = (slope_above - slope_below) / (above - below);
    c[1] = slope_below - c[2] * below;
  }
  double at(double t) const { return c[0] + (t - middle) * (c[1] + (t - middle) * c[2]); }
  double slope(double t) const { return c[1] + 2 * (t - middle) * c[2]; }
};

}  // namespace

template <class T>
AxisTaps<T>::AxisTaps(const std::vector<double>& taps, const std::array<TapRun, 2>& runs, int row_degree,
                      ConvolutionMethod how)
    : direct(taps.begin(), taps.end()), method(how), degree(row_degree) {
  const auto tap = [&](int t) { return taps[static_cast<std::size_t>(t + radius())]; };
  const bool usable = row_degree >= 0 && row_degree <= 2 && runs[0].length() == runs[1].length();
  if (usable && runs[0].length() > row_degree) length = runs[0].length();
  for (int t = -radius(); t <= radius(); ++t) {
    const bool in_run = has_runs() && std::any_of(runs.begin(), runs.end(),
                                                  [t](const TapRun& run) { return t >= run.first && t <= run.last; });
    if (!in_run && tap(t) != 0) singles.push_back({t, static_cast<T>(tap(t))});
  }
  for (std::size_t r = 0; r < 2 && has_runs(); ++r) {
    Polynomial& p = polynomials[r];
    p.run = runs[r];
    const Parabola parabola(runs[r], row_degree, tap);
    for (int t = runs[r].first - 1; t <= runs[r].last; ++t) {
      p.at.push_back(static_cast<T>(parabola.at(t)));
      p.slope.push_back(static_cast<T>(parabola.slope(t)));
    }
    p.half_curvature = static_cast<T>(parabola.c[2]);
  }
}

std::vector<double> scaled(std::vector<double> taps, double factor) {
  for (double& tap : taps) tap *= factor;
  return taps;
}

std::vector<double> reversed(const std::vector<double>& taps) { return {taps.rbegin(), taps.rend()}; }

std::array<TapRun, 2> reversed(const std::array<TapRun, 2>& runs) {
  return {TapRun{-runs[0].last, -runs[0].first}, TapRun{-runs[1].last, -runs[1].first}};
}

template struct AxisTaps<float>;
template struct AxisTaps<double>;

}  // namespace saltus
