#pragma once

#include <string>
#include <utility>
#include <vector>

namespace saltus::benchmark {

struct PlotPoint {
  double x = 0, y = 0;
  std::string label;  ///< beside the point; may be empty
};

struct PlotSeries {
  std::string name;  ///< the same name has the same colour in all panels
  std::vector<PlotPoint> points;
  bool is_connected = false;  ///< by a line, in the order of the points
  bool is_dashed = false;     ///< a line to compare with, whose points are not marked
};

struct PlotPanel {
  std::string title, note;  ///< the note stands under the title
  std::string y_label;
  std::vector<PlotSeries> series;
  bool has_log_y = false;  ///< else y begins at 0
};

/// Panels side by side with x on a logarithmic axis.
struct ScatterPlot {
  std::string title, subtitle, x_label;
  std::vector<PlotPanel> panels;
  int columns = 3;
};

/// A whole SVG file on a white ground, of its own size: panels in rows, a legend of the series below. Labels keep clear
/// of each other, of points and of their panel's frame as far as there is room. Throws std::invalid_argument that names
/// the panel for a coordinate that is not finite, or not above 0 on a logarithmic axis, or a panel without points.
std::string to_svg(const ScatterPlot& plot);

/// A rectangle in the units of the drawing.
struct Box {
  double left = 0, top = 0, width = 0, height = 0;

  bool overlaps(const Box& other) const {
    return left < other.left + other.width && other.left < left + width && top < other.top + other.height &&
           other.top < top + height;
  }
};

/// Where a label of each given size (width, height) may stand beside its point: boxes inside the frame that keep clear
/// of each other, of the points and of the lines (from one place to another), those nearest to their points first. One
/// that finds no such place takes the one that overlaps least.
using Place = std::pair<double, double>;
std::vector<Box> place_labels(const std::vector<Place>& points, const std::vector<Place>& sizes, const Box& frame,
                              const std::vector<std::pair<Place, Place>>& lines = {});

/// Ticks from `low` to `high`: on a linear axis at 1, 2 or 5 times a power of ten, at most `most`; on a logarithmic one
/// at powers of ten, with 2 and 5 between them where there is room.
std::vector<double> linear_ticks(double low, double high, int most);
std::vector<double> log_ticks(double low, double high, int most);

/// Without an exponent: 0.05, 2, 1000.
std::string tick_text(double value);

}  // namespace saltus::benchmark
