#include "core/kernels/kernel_profile.h"

#include <cmath>

namespace saltus {
KernelTaps cell_averaged_taps(const KernelProfile& profile, double h) {
  const double mass = profile.mass(), sigma = profile.width();
  KernelTaps taps;
  taps.radius = static_cast<int>(std::ceil(profile.support() / h)) + 1;
  const double support = profile.support();
  const bool is_compact = profile.value(support) == 0;
  for (int t = -taps.radius; t <= taps.radius; ++t) {
    // L'' = (delta_{-h} - 2 delta_0 + delta_h) / h^2, so integrals against L are second differences of antiderivatives.
    const auto second_difference = [h](double at, auto&& f) { return (f(at + h) + f(at - h) - 2 * f(at)) / (h * h); };
    const auto value = [&](double r) { return profile.value(r); };
    const auto first = [&](double r) { return profile.first_integral(r); };
    const auto second = [&](double r) { return profile.second_integral(r); };
    taps.value.push_back(h / mass * second_difference(t * h, second));
    taps.slope.push_back(sigma / mass * (profile.value(t * h) - profile.value((t - 1) * h)));
    taps.curvature.push_back(-h * sigma * sigma / mass * second_difference(t * h, value));
    taps.slope_gram.push_back(h * sigma / mass * second_difference((t - 0.5) * h, first));
    // Averages over where a kernel is 0 are 0, whatever rounding leaves of the differences.
    if (is_compact && (std::abs(t) - 1) * h >= support) taps.value.back() = taps.curvature.back() = 0;
    if (is_compact && (std::abs(t - 0.5) - 1) * h >= support) taps.slope_gram.back() = 0;
  }
  return taps;
}

}  // namespace saltus
