#pragma once

#include "core/drawing/raster.h"

#include <array>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace saltus::drawing {

/// The colours of a picture, from left to right, with a text at each end and in the middle.
struct ColourScale {
  std::function<Colour(double)> colour_at;  ///< of [0,1]
  std::array<std::string, 3> texts;
  std::string unit;
};

struct SheetPanel {
  std::string caption;
  Raster picture;
  std::optional<ColourScale> scale;
};

/// Each pixel as a square of `factor` pixels.
Raster magnified(const Raster& raster, int factor);

/// A figure of many pictures as one picture, on white: rows of panels, each with its caption above and its colour
/// scale below. Columns are as wide as their widest picture. A panel whose picture is empty leaves its place free.
Raster sheet(const std::vector<std::vector<SheetPanel>>& rows);

}  // namespace saltus::drawing
