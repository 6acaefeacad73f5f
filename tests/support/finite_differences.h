#pragma once

#include <cstddef>
#include <numeric>
#include <vector>

namespace saltus::testing {

/// Of vectors of any memory.
template <class A, class B>
double dot(const A& a, const B& b) {
  return std::inner_product(a.begin(), a.end(), b.begin(), 0.0);
}

inline std::vector<double> moved(const std::vector<double>& x, double step, const std::vector<double>& direction) {
  std::vector<double> result = x;
  for (std::size_t i = 0; i < x.size(); ++i) result[i] += step * direction[i];
  return result;
}

/// Derivative of f at x along a direction, by a central difference: exact up to step^2 where f is smooth.
template <class Function>
double slope_along(Function&& f, const std::vector<double>& x, const std::vector<double>& direction,
                   double step = 1e-6) {
  return (f(moved(x, step, direction)) - f(moved(x, -step, direction))) / (2 * step);
}

}  // namespace saltus::testing
