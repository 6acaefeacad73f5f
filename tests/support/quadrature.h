#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

namespace saltus::testing {

/// Integral of f from a to b, five-point Gauss rule on 40 panels between neighbouring breaks: good to rounding where f
/// is smooth between the breaks, which may be given in any order and outside of [a, b].
template <class Function>
double integral(Function&& f, double a, double b, std::vector<double> breaks = {}) {
  static constexpr double node[3] = {0.0, 0.5384693101056831, 0.9061798459386640};
  static constexpr double weight[3] = {0.5688888888888889, 0.4786286704993665, 0.2369268850561891};
  constexpr int panels = 40;
  std::erase_if(breaks, [&](double at) { return at <= a || at >= b; });
  breaks.push_back(a);
  breaks.push_back(b);
  std::sort(breaks.begin(), breaks.end());
  double sum = 0;
  for (std::size_t k = 0; k + 1 < breaks.size(); ++k) {
    const double half = (breaks[k + 1] - breaks[k]) / (2 * panels);
    for (int panel = 0; panel < panels; ++panel) {
      const double middle = breaks[k] + (2 * panel + 1) * half;
      sum += half * weight[0] * f(middle);
      for (int n = 1; n < 3; ++n) sum += half * weight[n] * (f(middle - half * node[n]) + f(middle + half * node[n]));
    }
  }
  return sum;
}

}  // namespace saltus::testing
