#include "core/drawing/line_chart.h"

#include "core/drawing/chart_scale.h"
#include "core/drawing/lettering.h"
#include "core/drawing/markup.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <sstream>

namespace saltus::drawing {
namespace {

constexpr double width = 420, height = 270, left = 62, right = 14, top = 46, bottom = 44;

/// What both renderings of a chart have in common.
struct Axes {
  Range x, y;
  double x_step = 1, y_step = 1, y_scale = 1;

  explicit Axes(const LineChart& chart) {
    for (const Curve& curve : chart.curves)
      for (const auto& [at, value] : curve.points)
        if (std::isfinite(at) && std::isfinite(value)) x.add(at), y.add(value);
    if (chart.y_starts_at_zero) y.add(0);
    widen_if_empty(x);
    widen_if_empty(y);
    x_step = chart.x_is_whole ? std::max(1.0, tick_step(x)) : tick_step(x);
    y_step = tick_step(y);
    y_scale = scale_of(y);
  }

  double to_x(double value) const { return left + (value - x.low) / (x.high - x.low) * (width - left - right); }
  double to_y(double value) const {
    return height - bottom - (value - y.low) / (y.high - y.low) * (height - top - bottom);
  }
  std::string y_label(const LineChart& chart) const {
    return y_scale == 1 ? chart.y_label : chart.y_label + " / " + number(y_scale, 1);
  }
};

// As the page's classes curve0 ... curve3.
constexpr Colour curve_colours[] = {{31, 95, 168}, {194, 84, 27}, {63, 143, 79}, {138, 79, 163}};

}  // namespace

std::string to_svg(const LineChart& chart) {
  const Axes axes(chart);
  std::ostringstream svg;
  svg.precision(5);
  svg << "<svg class=\"chart\" viewBox=\"0 0 " << width << ' ' << height << "\" role=\"img\" aria-label=\""
      << escaped(chart.title) << "\">\n<text class=\"chart-title\" x=\"" << left << "\" y=\"19\">"
      << escaped(chart.title) << "</text>\n";
  for (double tick : ticks(axes.y, axes.y_step))
    svg << "<line class=\"rule\" x1=\"" << left << "\" x2=\"" << width - right << "\" y1=\"" << axes.to_y(tick)
        << "\" y2=\"" << axes.to_y(tick) << "\"/><text class=\"tick\" text-anchor=\"end\" x=\"" << left - 6 << "\" y=\""
        << axes.to_y(tick) + 3.5 << "\">" << tick_text(tick / axes.y_scale, axes.y_step / axes.y_scale) << "</text>\n";
  for (double tick : ticks(axes.x, axes.x_step))
    svg << "<line class=\"rule\" x1=\"" << axes.to_x(tick) << "\" x2=\"" << axes.to_x(tick) << "\" y1=\""
        << height - bottom << "\" y2=\"" << height - bottom + 4
        << "\"/><text class=\"tick\" text-anchor=\"middle\" x=\"" << axes.to_x(tick) << "\" y=\""
        << height - bottom + 16 << "\">" << tick_text(tick, axes.x_step) << "</text>\n";
  svg << "<text class=\"label\" text-anchor=\"middle\" x=\"" << (left + width - right) / 2 << "\" y=\"" << height - 8
      << "\">" << escaped(chart.x_label)
      << "</text>\n<text class=\"label\" text-anchor=\"middle\" transform=\"translate(12 "
      << (top + height - bottom) / 2 << ") rotate(-90)\">" << escaped(axes.y_label(chart)) << "</text>\n";
  double legend = left;
  for (std::size_t i = 0; i < chart.curves.size(); ++i) {
    const Curve& curve = chart.curves[i];
    svg << "<polyline class=\"curve curve" << i << "\" points=\"";
    for (const auto& [at, value] : curve.points)
      if (std::isfinite(at) && std::isfinite(value)) svg << axes.to_x(at) << ',' << axes.to_y(value) << ' ';
    svg << "\"/>\n<line class=\"curve curve" << i << "\" x1=\"" << legend << "\" x2=\"" << legend + 18
        << "\" y1=\"32\" y2=\"32\"/><text class=\"tick\" x=\"" << legend + 22 << "\" y=\"35.5\">" << escaped(curve.name)
        << "</text>\n";
    legend += 36 + 6.2 * static_cast<double>(curve.name.size());
  }
  svg << "</svg>\n";
  return svg.str();
}

Raster to_raster(const LineChart& chart, double scale) {
  const Axes axes(chart);
  Raster raster(static_cast<int>(std::lround(scale * width)), static_cast<int>(std::lround(scale * height)));
  std::fill(raster.pixels.begin(), raster.pixels.end(), Colour{255, 255, 255});
  const Colour soft{98, 104, 111}, rule{220, 222, 223};
  const auto point = [&](double x, double y) { return Vector<2>(scale * x, scale * y); };
  const auto text = [&](const std::string& words, double x, double y, double size, TextAnchor anchor, Colour colour) {
    write(raster, words, point(x, y), {scale * size, colour, anchor});
  };
  text(chart.title, left, 19, 9, TextAnchor::Start, {29, 33, 38});
  Strokes rules;
  for (double tick : ticks(axes.y, axes.y_step)) {
    rules.push_back({point(left, axes.to_y(tick)), point(width - right, axes.to_y(tick))});
    text(tick_text(tick / axes.y_scale, axes.y_step / axes.y_scale), left - 6, axes.to_y(tick) + 3.5, 7.5,
         TextAnchor::End, soft);
  }
  for (double tick : ticks(axes.x, axes.x_step)) {
    rules.push_back({point(axes.to_x(tick), height - bottom), point(axes.to_x(tick), height - bottom + 4)});
    text(tick_text(tick, axes.x_step), axes.to_x(tick), height - bottom + 16, 7.5, TextAnchor::Middle, soft);
  }
  draw(raster, rules, {rule, scale});
  text(chart.x_label, (left + width - right) / 2, height - 8, 7.5, TextAnchor::Middle, soft);
  write_upwards(raster, axes.y_label(chart), point(16, (top + height - bottom) / 2),
                {scale * 7.5, soft, TextAnchor::Middle});
  double legend = left;
  for (std::size_t i = 0; i < chart.curves.size(); ++i) {
    const Curve& curve = chart.curves[i];
    const Pen pen{curve_colours[i % std::size(curve_colours)], 1.8 * scale};
    Stroke stroke;
    for (const auto& [at, value] : curve.points) stroke.push_back(point(axes.to_x(at), axes.to_y(value)));
    draw(raster, {stroke, {point(legend, 32), point(legend + 18, 32)}}, pen);
    text(curve.name, legend + 23, 35.5, 7.5, TextAnchor::Start, soft);
    legend += 36 + text_width(curve.name, 7.5);
  }
  return raster;
}

}  // namespace saltus::drawing
