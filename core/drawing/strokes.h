#pragma once

#include "core/drawing/raster.h"
#include "core/grid/image_grid.h"

#include <vector>

namespace saltus::drawing {

/// A line through points, in picture pixels: (0, 0) is the top left corner of the first pixel.
using Stroke = std::vector<Vector<2>>;
using Strokes = std::vector<Stroke>;

struct Pen {
  Colour colour{0, 0, 0};
  double width = 1;  ///< pixels
  double opacity = 1;
};

/// Draws lines with round ends and soft edges. Where they cross they cover no more than one of them does. What lies
/// beyond the picture is left out; a point that is not finite breaks its line.
void draw(Raster& raster, const Strokes& strokes, const Pen& pen);

/// The strokes with every coordinate times `factor`.
Strokes scaled(Strokes strokes, double factor);

}  // namespace saltus::drawing
