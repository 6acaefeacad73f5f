#include "core/drawing/line_chart.h"

#include "core/drawing/markup.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>

namespace saltus::drawing {
namespace {

constexpr double width = 420, height = 270, left = 62, right = 14, top = 46, bottom = 44;

struct Range {
  double low = std::numeric_limits<double>::infinity();
  double high = -std::numeric_limits<double>::infinity();
  void add(double value) {
    low = std::min(low, value);
    high = std::max(high, value);
  }
};

/// 1, 2 or 5 times a power of ten, so that about four steps fill the range.
double tick_step(const Range& range) {
  const double rough = (range.high - range.low) / 4, decade = std::pow(10, std::floor(std::log10(rough)));
  for (double factor : {1.0, 2.0, 5.0})
    if (factor * decade >= rough) return factor * decade;
  return 10 * decade;
}

void widen_if_empty(Range& range) {
  if (!(range.low <= range.high)) range = {0, 1};
  if (range.high - range.low > 1e-12 * std::max(std::abs(range.low), std::abs(range.high))) return;
  const double margin = range.low == 0 ? 1 : std::abs(range.low) * 0.05;
  range = {range.low - margin, range.high + margin};
}

/// Power of ten, a multiple of 3, that is taken out of large and small values so that ticks stay short.
double scale_of(const Range& range) {
  const double size = std::max(std::abs(range.low), std::abs(range.high));
  return size >= 1e4 || size < 1e-2 ? std::pow(10, 3 * std::floor(std::log10(size) / 3)) : 1;
}

std::string tick_text(double value, double step) {
  if (std::abs(value) < step / 1e6) return "0";
  const int digits = static_cast<int>(std::ceil(std::log10(std::abs(value) / step) + 1e-9)) + 1;
  return number(value, std::clamp(digits, 1, 6));
}

}  // namespace

std::string to_svg(const LineChart& chart) {
  Range x, y;
  for (const Curve& curve : chart.curves)
    for (const auto& [at, value] : curve.points)
      if (std::isfinite(at) && std::isfinite(value)) x.add(at), y.add(value);
  if (chart.y_starts_at_zero) y.add(0);
  widen_if_empty(x);
  widen_if_empty(y);
  const double y_scale = scale_of(y);
  const auto to_x = [&](double value) { return left + (value - x.low) / (x.high - x.low) * (width - left - right); };
  const auto to_y = [&](double value) {
    return height - bottom - (value - y.low) / (y.high - y.low) * (height - top - bottom);
  };

  std::ostringstream svg;
  svg.precision(5);
  svg << "<svg class=\"chart\" viewBox=\"0 0 " << width << ' ' << height << "\" role=\"img\" aria-label=\""
      << escaped(chart.title) << "\">\n<text class=\"chart-title\" x=\"" << left << "\" y=\"19\">"
      << escaped(chart.title) << "</text>\n";
  const double y_step = tick_step(y), x_step = chart.x_is_whole ? std::max(1.0, tick_step(x)) : tick_step(x);
  for (double tick = std::ceil(y.low / y_step - 1e-9) * y_step; tick <= y.high + y_step * 1e-9; tick += y_step)
    svg << "<line class=\"rule\" x1=\"" << left << "\" x2=\"" << width - right << "\" y1=\"" << to_y(tick) << "\" y2=\""
        << to_y(tick) << "\"/><text class=\"tick\" text-anchor=\"end\" x=\"" << left - 6 << "\" y=\""
        << to_y(tick) + 3.5 << "\">" << tick_text(tick / y_scale, y_step / y_scale) << "</text>\n";
  for (double tick = std::ceil(x.low / x_step - 1e-9) * x_step; tick <= x.high + x_step * 1e-9; tick += x_step)
    svg << "<line class=\"rule\" x1=\"" << to_x(tick) << "\" x2=\"" << to_x(tick) << "\" y1=\"" << height - bottom
        << "\" y2=\"" << height - bottom + 4 << "\"/><text class=\"tick\" text-anchor=\"middle\" x=\"" << to_x(tick)
        << "\" y=\"" << height - bottom + 16 << "\">" << tick_text(tick, x_step) << "</text>\n";
  svg << "<text class=\"label\" text-anchor=\"middle\" x=\"" << (left + width - right) / 2 << "\" y=\"" << height - 8
      << "\">" << escaped(chart.x_label)
      << "</text>\n<text class=\"label\" text-anchor=\"middle\" transform=\"translate(12 "
      << (top + height - bottom) / 2 << ") rotate(-90)\">"
      << escaped(y_scale == 1 ? chart.y_label : chart.y_label + " / " + number(y_scale, 1)) << "</text>\n";
  double legend = left;
  for (std::size_t i = 0; i < chart.curves.size(); ++i) {
    const Curve& curve = chart.curves[i];
    svg << "<polyline class=\"curve curve" << i << "\" points=\"";
    for (const auto& [at, value] : curve.points)
      if (std::isfinite(at) && std::isfinite(value)) svg << to_x(at) << ',' << to_y(value) << ' ';
    svg << "\"/>\n<line class=\"curve curve" << i << "\" x1=\"" << legend << "\" x2=\"" << legend + 18
        << "\" y1=\"32\" y2=\"32\"/><text class=\"tick\" x=\"" << legend + 22 << "\" y=\"35.5\">" << escaped(curve.name)
        << "</text>\n";
    legend += 36 + 6.2 * static_cast<double>(curve.name.size());
  }
  svg << "</svg>\n";
  return svg.str();
}

}  // namespace saltus::drawing
