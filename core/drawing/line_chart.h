#pragma once

#include "core/drawing/raster.h"

#include <string>
#include <utility>
#include <vector>

namespace saltus::drawing {

struct Curve {
  std::string name;                               ///< in the legend
  std::vector<std::pair<double, double>> points;  ///< x ascending
};

struct LineChart {
  std::string title, x_label, y_label;
  std::vector<Curve> curves;      ///< at most four, told apart by the page's classes curve0 ... curve3
  bool y_starts_at_zero = false;  ///< instead of at the least value
  bool x_is_whole = false;        ///< x counts something: no ticks between whole numbers
};

/// An <svg> element. Points that are not finite are left out.
std::string to_svg(const LineChart& chart);

/// The same as a picture of 420 x 270 pixels times `scale`, on white. A point that is not finite breaks its curve.
Raster to_raster(const LineChart& chart, double scale = 1);

}  // namespace saltus::drawing
