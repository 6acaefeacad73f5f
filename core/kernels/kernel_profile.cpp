#include "core/kernels/kernel_profile.h"

#include <cmath>

namespace saltus {

KernelTaps cell_averaged_taps(const KernelProfile& profile, double h) {
  const double mass = profile.mass(), sigma = profile.width();
  KernelTaps taps;
  taps.radius = static_cast<int>(std::ceil(profile.support() / h));
  for (int j = -taps.radius; j <= taps.radius; ++j) {
    const double below = (j - 1) * h, at = j * h, above = (j + 1) * h;
    // L'' = (delta_{-h} - 2 delta_0 + delta_h) / h^2, so each integral is a second difference of an antiderivative.
    const auto second_difference = [&](auto&& f) { return (f(above) - 2 * f(at) + f(below)) / (h * h); };
    taps.value.push_back(h / mass * second_difference([&](double r) { return profile.second_integral(r); }));
    taps.slope.push_back(h * sigma / mass * second_difference([&](double r) { return profile.first_integral(r); }));
    taps.curvature.push_back(-h * sigma * sigma / mass * second_difference([&](double r) { return profile.value(r); }));
  }
  return taps;
}

}  // namespace saltus
