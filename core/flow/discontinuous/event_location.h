#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

namespace saltus {

/// Where f, which is positive or about to become so at `low`, first falls to 0 in (low, high]; empty when it does not.
/// f is smooth there. It is sampled at kEventSamples + 1 places; roots of even order or pairs of roots between two
/// samples are found from the minimum between them. The root is bracketed and halved by Illinois steps down to
/// `tolerance` in the argument.
constexpr int kEventSamples = 8;

namespace detail {

/// Argument of the smallest sign * f in [low, high] by golden section; stops where it is below 0.
template <class Function>
double extremum(Function&& f, double sign, double low, double high) {
  const double ratio = 0.6180339887498949;
  double a = high - ratio * (high - low), b = low + ratio * (high - low);
  double fa = sign * f(a), fb = sign * f(b);
  for (int i = 0; i < 40; ++i) {
    if (fa < 0) return a;
    if (fb < 0) return b;
    if (fa < fb) {
      high = b, b = a, fb = fa;
      a = high - ratio * (high - low), fa = sign * f(a);
    } else {
      low = a, a = b, fa = fb;
      b = low + ratio * (high - low), fb = sign * f(b);
    }
  }
  return fa < fb ? a : b;
}

/// Root in [low, high] with f(low) > 0 >= f(high).
template <class Function>
double bracketed_root(Function&& f, double low, double f_low, double high, double f_high, double tolerance) {
  int side = 0;
  for (int i = 0; i < 200 && high - low > tolerance && f_high != 0; ++i) {
    double middle = (f_low * high - f_high * low) / (f_low - f_high);
    if (i % 4 == 3 || !(middle > low && middle < high)) middle = 0.5 * (low + high);
    const double value = f(middle);
    if (value > 0) {
      low = middle, f_low = value;
      if (side == 1) f_high /= 2;
      side = 1;
    } else {
      high = middle, f_high = value;
      if (side == -1) f_low /= 2;
      side = -1;
    }
  }
  return high;
}

}  // namespace detail

template <class Function>
std::optional<double> first_fall(Function&& f, double low, double high, double tolerance) {
  std::array<double, kEventSamples + 1> at, value;
  for (int i = 0; i <= kEventSamples; ++i) {
    at[i] = low + (high - low) * i / kEventSamples;
    value[i] = f(at[i]);
    if (i == 0) continue;
    if (value[i - 1] > 0 && value[i] > 0) {
      // A dip below 0 between samples shows as a minimum next to this interval; in the first and last one, by f being
      // lower just inside than at the end.
      const double inside = 1e-4 * (at[i] - at[i - 1]);
      int from = i;
      if (i >= 2 && value[i - 1] <= value[i] && value[i - 1] <= value[i - 2] && value[i - 2] > 0)
        from = i - 2;
      else if ((i == 1 && f(low + inside) < value[0]) || (i == kEventSamples && f(high - inside) < value[i]))
        from = i - 1;
      if (from == i) continue;
      const double dip = detail::extremum(f, 1.0, at[from], at[i]);
      const double depth = f(dip);
      if (depth <= 0) return detail::bracketed_root(f, at[from], value[from], dip, depth, tolerance);
    } else if (value[i - 1] > 0) {
      return detail::bracketed_root(f, at[i - 1], value[i - 1], at[i], value[i], tolerance);
    } else if (value[i] <= 0) {
      // Starts at 0: it may have risen and fallen again before the next sample.
      const double top = detail::extremum(f, -1.0, at[i - 1], at[i]);
      const double height = f(top);
      if (!(height > 0)) return at[i - 1];
      return detail::bracketed_root(f, top, height, at[i], value[i], tolerance);
    }
  }
  return std::nullopt;
}

}  // namespace saltus
