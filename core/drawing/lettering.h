#pragma once

#include "core/drawing/strokes.h"

#include <string_view>

namespace saltus::drawing {

/// Where a text stands against the point that it is given.
enum class TextAnchor { Start, Middle, End };

struct TextStyle {
  double height = 10;  ///< of capitals, pixels
  Colour colour{29, 33, 38};
  TextAnchor anchor = TextAnchor::Start;
};

/// Pixels from the first letter's left to the last one's right edge.
double text_width(std::string_view text, double height);

/// Writes printable ASCII in plain strokes, the baseline starting, centred or ending at `at`; any other byte shows as
/// a question mark. A picture thus needs no font.
void write(Raster& raster, std::string_view text, const Vector<2>& at, const TextStyle& style = {});

/// The same from the bottom to the top, turned by 90 degrees.
void write_upwards(Raster& raster, std::string_view text, const Vector<2>& at, const TextStyle& style = {});

}  // namespace saltus::drawing
