#include "core/drawing/colour_map.h"

#include <algorithm>
#include <cmath>
#include <span>

namespace saltus::drawing {
namespace {

// Anchors at even distances. `sequential` follows viridis, `diverging` ColorBrewer's RdBu.
constexpr Colour sequential_anchors[] = {{68, 1, 84},    {72, 40, 120},  {62, 74, 137},  {49, 104, 142},
                                         {38, 130, 142}, {31, 158, 137}, {53, 183, 121}, {109, 205, 89},
                                         {180, 222, 44}, {253, 231, 37}};
constexpr Colour diverging_anchors[] = {{5, 48, 97},     {33, 102, 172},  {67, 147, 195},  {146, 197, 222},
                                        {209, 229, 240}, {247, 247, 247}, {253, 219, 199}, {244, 165, 130},
                                        {214, 96, 77},   {178, 24, 43},   {103, 0, 31}};
constexpr Colour interface_anchors[] = {{0, 200, 255}, {120, 225, 140}, {255, 225, 50}, {255, 140, 30}, {250, 40, 40}};
constexpr Colour heat_anchors[] = {{0, 0, 4}, {87, 16, 110}, {188, 55, 84}, {249, 142, 9}, {252, 255, 164}};

Colour between(std::span<const Colour> anchors, double value) {
  if (std::isnan(value)) return {128, 128, 128};
  const double at = std::clamp(value, 0.0, 1.0) * static_cast<double>(anchors.size() - 1);
  const std::size_t low = std::min(static_cast<std::size_t>(at), anchors.size() - 2);
  return blend(anchors[low], anchors[low + 1], at - static_cast<double>(low));
}

}  // namespace

Colour grey(double value) {
  constexpr Colour anchors[] = {{0, 0, 0}, {255, 255, 255}};
  return between(anchors, value);
}
Colour sequential(double value) { return between(sequential_anchors, value); }
Colour diverging(double value) { return between(diverging_anchors, (value + 1) / 2); }
Colour heat(double value) { return between(heat_anchors, value); }

Colour interface_colour(double value) { return between(interface_anchors, value); }

Colour blend(Colour under, Colour over, double opacity) {
  Colour mixed;
  for (int c = 0; c < 3; ++c)
    mixed[c] = static_cast<std::uint8_t>(std::lround(under[c] + opacity * (over[c] - under[c])));
  return mixed;
}

}  // namespace saltus::drawing
