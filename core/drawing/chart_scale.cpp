#include "core/drawing/chart_scale.h"

#include "core/drawing/markup.h"

#include <algorithm>
#include <cmath>

namespace saltus::drawing {

void Range::add(double value) {
  low = std::min(low, value);
  high = std::max(high, value);
}

double tick_step(const Range& range) {
  const double rough = (range.high - range.low) / 4, decade = std::pow(10, std::floor(std::log10(rough)));
  for (double factor : {1.0, 2.0, 5.0})
    if (factor * decade >= rough) return factor * decade;
  return 10 * decade;
}

std::vector<double> ticks(const Range& range, double step) {
  std::vector<double> all;
  for (double tick = std::ceil(range.low / step - 1e-9) * step; tick <= range.high + step * 1e-9; tick += step)
    all.push_back(tick);
  return all;
}

void widen_if_empty(Range& range) {
  if (!(range.low <= range.high)) range = {0, 1};
  if (range.high - range.low > 1e-12 * std::max(std::abs(range.low), std::abs(range.high))) return;
  const double margin = range.low == 0 ? 1 : std::abs(range.low) * 0.05;
  range = {range.low - margin, range.high + margin};
}

double scale_of(const Range& range) {
  const double size = std::max(std::abs(range.low), std::abs(range.high));
  return size >= 1e4 || size < 1e-2 ? std::pow(10, 3 * std::floor(std::log10(size) / 3)) : 1;
}

std::string tick_text(double value, double step) {
  if (std::abs(value) < step / 1e6) return "0";
  const int digits = static_cast<int>(std::ceil(std::log10(std::abs(value) / step) + 1e-9)) + 1;
  return number(value, std::clamp(digits, 1, 6));
}

}  // namespace saltus::drawing
