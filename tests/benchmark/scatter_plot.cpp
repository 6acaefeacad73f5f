#include "tests/benchmark/scatter_plot.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <sstream>
#include <stdexcept>

namespace saltus::benchmark {
namespace {

constexpr double kPanelWidth = 300, kPanelHeight = 250, kMargin = 16, kGap = 14;
constexpr double kLeft = 46, kRight = 10, kTop = 46, kBottom = 36;  ///< around a panel's frame
constexpr double kFont = 11, kLetter = 0.58;                        ///< mean width of a letter, in font sizes
constexpr double kRadius = 4;

/// Told apart also without colour vision (Okabe and Ito).
const char* const kColours[] = {"#d55e00", "#0072b2", "#009e73", "#cc79a7", "#7a5c00", "#56b4e9", "#444444", "#e69f00"};

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f", value);
  return text;
}

std::string escaped(const std::string& text) {
  std::string result;
  for (char c : text) switch (c) {
      case '&':
        result += "&amp;";
        break;
      case '<':
        result += "&lt;";
        break;
      case '>':
        result += "&gt;";
        break;
      case '"':
        result += "&quot;";
        break;
      default:
        result += c;
    }
  return result;
}

double text_width(const std::string& text) {
  // Bytes that go on with a letter of UTF-8 take no room.
  const auto letters = std::count_if(text.begin(), text.end(), [](char c) { return (c & 0xc0) != 0x80; });
  return kLetter * kFont * static_cast<double>(letters);
}

struct Axis {
  double low = 0, high = 1, from = 0, to = 1;  ///< values, and where they are in the drawing
  bool is_log = false;

  double at(double value) const {
    const double share = is_log ? std::log(value / low) / std::log(high / low) : (value - low) / (high - low);
    return from + share * (to - from);
  }
};

void check(const PlotPanel& panel) {
  bool is_empty = true;
  for (const PlotSeries& series : panel.series)
    for (const PlotPoint& point : series.points) {
      is_empty = false;
      const double least_y = panel.has_log_y ? std::numeric_limits<double>::min() : -1e300;
      if (!std::isfinite(point.x) || !std::isfinite(point.y) || !(point.x > 0) || !(point.y >= least_y))
        throw std::invalid_argument("panel '" + panel.title + "' has a point that its axes cannot show");
    }
  if (is_empty) throw std::invalid_argument("panel '" + panel.title + "' has no points");
}

Axis log_axis(double least, double most, double from, double to, double room) {
  const double factor = std::max(std::pow(most / least, room), 1.3);
  return {least / factor, most * factor, from, to, true};
}

void draw_panel(const PlotPanel& panel, const std::string& x_label, const std::vector<std::string>& names, double left,
                double top, std::ostream& out) {
  check(panel);
  double least_x = 1e300, most_x = 0, least_y = 1e300, most_y = -1e300;
  for (const PlotSeries& series : panel.series)
    for (const PlotPoint& point : series.points) {
      least_x = std::min(least_x, point.x), most_x = std::max(most_x, point.x);
      least_y = std::min(least_y, point.y), most_y = std::max(most_y, point.y);
    }
  const Box frame{left + kLeft, top + kTop, kPanelWidth - kLeft - kRight, kPanelHeight - kTop - kBottom};
  const Axis x = log_axis(least_x, most_x, frame.left, frame.left + frame.width, 0.12);
  Axis y = log_axis(1, 2, frame.top + frame.height, frame.top, 0.12);
  if (panel.has_log_y)
    y = log_axis(least_y, most_y, frame.top + frame.height, frame.top, 0.12);
  else
    y.is_log = false, y.low = std::min(0.0, least_y), y.high = most_y > 0 ? 1.18 * most_y : 1;

  const auto text = [&](double at_x, double at_y, const char* kind, const std::string& words) {
    out << "<text x=\"" << number(at_x) << "\" y=\"" << number(at_y) << "\" class=\"" << kind << "\">" << escaped(words)
        << "</text>\n";
  };
  text(left + kLeft, top + 16, "panel", panel.title);
  text(left + kLeft, top + 31, "note", panel.note);
  out << "<rect class=\"frame\" x=\"" << number(frame.left) << "\" y=\"" << number(frame.top) << "\" width=\""
      << number(frame.width) << "\" height=\"" << number(frame.height) << "\"/>\n";
  for (double tick : log_ticks(x.low, x.high, 6)) {
    out << "<path class=\"grid\" d=\"M" << number(x.at(tick)) << ' ' << number(frame.top) << 'v' << number(frame.height)
        << "\"/>\n";
    text(x.at(tick), frame.top + frame.height + 14, "tick middle", tick_text(tick));
  }
  for (double tick : panel.has_log_y ? log_ticks(y.low, y.high, 6) : linear_ticks(y.low, y.high, 6)) {
    out << "<path class=\"grid\" d=\"M" << number(frame.left) << ' ' << number(y.at(tick)) << 'h' << number(frame.width)
        << "\"/>\n";
    text(frame.left - 5, y.at(tick) + 4, "tick end", tick_text(tick));
  }
  text(frame.left + frame.width / 2, frame.top + frame.height + 30, "tick middle", x_label);
  out << "<text class=\"tick middle\" transform=\"translate(" << number(left + 12) << ' '
      << number(frame.top + frame.height / 2) << ") rotate(-90)\">" << escaped(panel.y_label) << "</text>\n";

  std::vector<Place> places, sizes;
  std::vector<std::pair<Place, Place>> lines;
  std::vector<std::string> labels, colours;
  for (const PlotSeries& series : panel.series) {
    const auto index = static_cast<std::size_t>(std::find(names.begin(), names.end(), series.name) - names.begin());
    const std::string colour = kColours[index % std::size(kColours)];
    if (series.is_connected && series.points.size() > 1) {
      out << "<path class=\"line\" stroke=\"" << colour << '"' << (series.is_dashed ? " stroke-dasharray=\"5 4\"" : "")
          << " d=\"";
      for (std::size_t k = 1; k < series.points.size(); ++k)
        lines.push_back({{x.at(series.points[k - 1].x), y.at(series.points[k - 1].y)},
                         {x.at(series.points[k].x), y.at(series.points[k].y)}});
      for (std::size_t k = 0; k < series.points.size(); ++k)
        out << (k ? 'L' : 'M') << number(x.at(series.points[k].x)) << ' ' << number(y.at(series.points[k].y));
      out << "\"/>\n";
    }
    for (const PlotPoint& point : series.points) {
      places.emplace_back(x.at(point.x), y.at(point.y));
      sizes.emplace_back(text_width(point.label), point.label.empty() ? 0 : kFont + 1);
      labels.push_back(point.label);
      colours.push_back(colour);
      if (!series.is_dashed)
        out << "<circle cx=\"" << number(places.back().first) << "\" cy=\"" << number(places.back().second) << "\" r=\""
            << number(kRadius) << "\" fill=\"" << colour << "\"/>\n";
    }
  }
  const std::vector<Box> boxes = place_labels(places, sizes, frame, lines);
  for (std::size_t k = 0; k < boxes.size(); ++k) {
    if (labels[k].empty()) continue;
    const Box& box = boxes[k];
    // A thin line to a label that had to stand away from its point.
    const double near_x = std::clamp(places[k].first, box.left, box.left + box.width),
                 near_y = std::clamp(places[k].second, box.top, box.top + box.height);
    if (std::hypot(near_x - places[k].first, near_y - places[k].second) > 3 * kRadius)
      out << "<path class=\"lead\" d=\"M" << number(places[k].first) << ' ' << number(places[k].second) << 'L'
          << number(near_x) << ' ' << number(near_y) << "\"/>\n";
    out << "<text x=\"" << number(box.left) << "\" y=\"" << number(box.top + kFont - 1.5)
        << "\" class=\"label\" style=\"fill:" << colours[k] << "\">" << escaped(labels[k]) << "</text>\n";
  }
}

}  // namespace

std::vector<Box> place_labels(const std::vector<Place>& points, const std::vector<Place>& sizes, const Box& frame,
                              const std::vector<std::pair<Place, Place>>& lines) {
  std::vector<Box> obstacles;
  for (const auto& [x, y] : points)
    obstacles.push_back({x - kRadius - 1, y - kRadius - 1, 2 * kRadius + 2, 2 * kRadius + 2});
  for (const auto& [from, to] : lines) {
    const int steps = 1 + static_cast<int>(std::hypot(to.first - from.first, to.second - from.second) / 3);
    for (int k = 0; k <= steps; ++k) {
      const double t = static_cast<double>(k) / steps;
      obstacles.push_back(
          {from.first + t * (to.first - from.first) - 1.5, from.second + t * (to.second - from.second) - 1.5, 3, 3});
    }
  }
  std::vector<Box> placed;
  for (std::size_t k = 0; k < points.size(); ++k) {
    const auto [x, y] = points[k];
    const auto [width, height] = sizes[k];
    Box best{x, y, width, height};
    double least = 1e300;
    // Rings around the point: right, left, above and below, then between; each ring further away.
    for (int ring = 0; ring < 24 && least > 0 && width > 0; ++ring) {
      const double away = kRadius + 3 + 9 * ring;
      for (int turn = 0; turn < 16 && least > 0; ++turn) {
        static constexpr int kOrder[] = {0, 8, 4, 12, 2, 6, 10, 14, 1, 7, 9, 15, 3, 5, 11, 13};
        const double angle = kOrder[turn] * 3.14159265358979 / 8, dx = std::cos(angle), dy = std::sin(angle);
        Box box{x + away * dx + (dx - 1) / 2 * width, y + away * dy + (dy - 1) / 2 * height, width, height};
        double overlap = 0;
        const auto add = [&](const Box& other) {
          if (!box.overlaps(other)) return;
          overlap += (std::min(box.left + width, other.left + other.width) - std::max(box.left, other.left)) *
                     (std::min(box.top + height, other.top + other.height) - std::max(box.top, other.top));
        };
        for (const Box& other : obstacles) add(other);
        for (const Box& other : placed) add(other);
        overlap += 100 * (std::max(0.0, frame.left - box.left) + std::max(0.0, frame.top - box.top) +
                          std::max(0.0, box.left + width - frame.left - frame.width) +
                          std::max(0.0, box.top + height - frame.top - frame.height));
        if (overlap < least) least = overlap, best = box;
      }
    }
    placed.push_back(best);
  }
  return placed;
}

std::vector<double> linear_ticks(double low, double high, int most) {
  double step = std::pow(10.0, std::floor(std::log10((high - low) / most)));
  for (double factor : {1.0, 2.0, 5.0, 10.0}) {
    const double wider = factor * step;
    if (std::floor(high / wider) - std::ceil(low / wider) + 1 <= most) {
      step = wider;
      break;
    }
  }
  std::vector<double> ticks;
  for (double k = std::ceil(low / step); k * step <= high * (1 + 1e-12); ++k) ticks.push_back(k * step);
  return ticks;
}

std::vector<double> log_ticks(double low, double high, int most) {
  const int first = static_cast<int>(std::floor(std::log10(low))), last = static_cast<int>(std::ceil(std::log10(high)));
  const auto with = [&](const std::vector<double>& factors, int every) {
    std::vector<double> ticks;
    for (int power = first; power <= last; ++power)
      for (double factor : factors) {
        // The power that divides stays exact: 0.2 instead of 2 * 0.1.
        const double value = power < 0 ? factor / std::pow(10.0, -power) : factor * std::pow(10.0, power);
        if (value >= low && value <= high && power % every == 0) ticks.push_back(value);
      }
    return ticks;
  };
  for (const std::vector<double>& factors : {std::vector<double>{1, 2, 5}, {1, 3}, {1}}) {
    const std::vector<double> ticks = with(factors, 1);
    if (static_cast<int>(ticks.size()) <= most) return ticks;
  }
  int every = 2;
  while (static_cast<int>(with({1}, every).size()) > most) ++every;
  return with({1}, every);
}

std::string tick_text(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.10f", value);
  std::string result = text;
  result.erase(result.find_last_not_of('0') + 1);
  if (result.back() == '.') result.pop_back();
  return result;
}

std::string to_svg(const ScatterPlot& plot) {
  std::vector<std::string> names;
  std::vector<const PlotSeries*> kinds;
  for (const PlotPanel& panel : plot.panels)
    for (const PlotSeries& series : panel.series)
      if (std::find(names.begin(), names.end(), series.name) == names.end()) {
        names.push_back(series.name);
        kinds.push_back(&series);
      }
  const int columns = std::max(1, std::min(plot.columns, static_cast<int>(plot.panels.size())));
  const int rows = (static_cast<int>(plot.panels.size()) + columns - 1) / columns;
  const double head = plot.subtitle.empty() ? 40 : 58, foot = 30;
  const double width = 2 * kMargin + columns * kPanelWidth + (columns - 1) * kGap;
  const double height = head + rows * (kPanelHeight + kGap) + foot;
  std::ostringstream out;
  out << "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"" << number(width) << "\" height=\"" << number(height)
      << "\" viewBox=\"0 0 " << number(width) << ' ' << number(height) << "\" role=\"img\">\n<title>"
      << escaped(plot.title) << "</title>\n<style>\n"
      << "text{font-family:system-ui,-apple-system,'Segoe UI',Roboto,'DejaVu Sans',sans-serif;fill:#333}\n"
      << ".head{font-size:17px;font-weight:600}.note,.tick{font-size:10.5px;fill:#666}.panel{font-size:13px;"
      << "font-weight:600}.label{font-size:" << kFont << "px}.legend{font-size:12px}\n"
      << ".middle{text-anchor:middle}.end{text-anchor:end}.frame{fill:#fafafa;stroke:#ccc}.grid{stroke:#e6e6e6;"
      << "fill:none}.line{fill:none;stroke-width:1.8}.lead{stroke:#999;stroke-width:.7;fill:none}\n</style>\n"
      << "<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
      << "<text x=\"" << number(kMargin) << "\" y=\"26\" class=\"head\">" << escaped(plot.title) << "</text>\n";
  if (!plot.subtitle.empty())
    out << "<text x=\"" << number(kMargin) << "\" y=\"45\" class=\"note\">" << escaped(plot.subtitle) << "</text>\n";
  for (std::size_t k = 0; k < plot.panels.size(); ++k)
    draw_panel(plot.panels[k], plot.x_label, names, kMargin + (kPanelWidth + kGap) * static_cast<double>(k % columns),
               head + (kPanelHeight + kGap) * static_cast<double>(k / columns), out);
  double at = kMargin + kLeft;
  const double legend = height - 14;
  for (std::size_t k = 0; k < names.size(); ++k) {
    out << "<circle cx=\"" << number(at) << "\" cy=\"" << number(legend - 4) << "\" r=\"" << number(kRadius)
        << "\" fill=\"" << kColours[k % std::size(kColours)] << "\"/>\n<text x=\"" << number(at + 9) << "\" y=\""
        << number(legend) << "\" class=\"legend\">" << escaped(names[k]) << "</text>\n";
    at += 36 + 1.15 * text_width(names[k]);
  }
  out << "</svg>\n";
  return out.str();
}

}  // namespace saltus::benchmark
