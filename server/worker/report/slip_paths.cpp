#include "server/worker/report/slip_paths.h"

#include "core/drawing/colour_map.h"

#include <algorithm>
#include <cstdio>

namespace saltus::report {

std::size_t SlipPaths::class_of(double slip_mm) const {
  return static_cast<std::size_t>(std::clamp(static_cast<int>(kClasses * slip_mm / most_mm_), 0, int{kClasses} - 1));
}

void SlipPaths::add_line(double slip_mm, const Vector<2>& from, const Vector<2>& to) {
  char text[96];
  std::snprintf(text, sizeof text, "M%.1f %.1fL%.1f %.1f", from[0], from[1], to[0], to[1]);
  lines_[class_of(slip_mm)] += text;
}

void SlipPaths::add_rectangle(double slip_mm, const Vector<2>& one, const Vector<2>& other) {
  char text[96];
  std::snprintf(text, sizeof text, "M%.1f %.1fH%.1fV%.1fH%.1fZ", one[0], one[1], other[0], other[1], one[0]);
  areas_[class_of(slip_mm)] += text;
}

std::string SlipPaths::text() const {
  std::string paths;
  for (std::size_t kind = 0; kind < kClasses; ++kind) {
    const drawing::Colour rgb = drawing::interface_colour((static_cast<double>(kind) + 0.5) / kClasses);
    char colour[8];
    std::snprintf(colour, sizeof colour, "#%02x%02x%02x", rgb[0], rgb[1], rgb[2]);
    if (!areas_[kind].empty())
      paths += std::string("<path class=\"face\" style=\"fill:") + colour + "\" d=\"" + areas_[kind] + "\"/>";
    if (!lines_[kind].empty())
      paths += std::string("<path style=\"stroke:") + colour + "\" d=\"" + lines_[kind] + "\"/>";
  }
  return paths;
}

}  // namespace saltus::report
