#include "core/drawing/strokes.h"

#include "core/drawing/colour_map.h"

#include <algorithm>
#include <cmath>

namespace saltus::drawing {
namespace {

double distance_to_segment(const Vector<2>& point, const Vector<2>& from, const Vector<2>& to) {
  const Vector<2> along = to - from;
  const double squared = along.squaredNorm();
  const double at = squared > 0 ? std::clamp((point - from).dot(along) / squared, 0.0, 1.0) : 0.0;
  return (point - from - at * along).norm();
}

}  // namespace

void draw(Raster& raster, const Strokes& strokes, const Pen& pen) {
  // How much of each pixel is covered, over all lines, before any is coloured: crossings then do not show as dots.
  std::vector<float> cover(raster.pixels.size(), 0.0f);
  const double reach = pen.width / 2 + 0.5;
  for (const Stroke& stroke : strokes)
    for (std::size_t i = 0; i + 1 < std::max<std::size_t>(stroke.size(), 1); ++i) {
      const Vector<2>&from = stroke[i], &to = stroke[i + 1];
      if (!from.allFinite() || !to.allFinite()) continue;
      const Vector<2> low = from.cwiseMin(to).array() - reach, high = from.cwiseMax(to).array() + reach;
      const auto clipped = [](double value, int extent) {
        return static_cast<int>(std::clamp(value, 0.0, static_cast<double>(extent)));
      };
      const int left = clipped(std::floor(low[0]), raster.width), right = clipped(std::ceil(high[0]), raster.width);
      const int top = clipped(std::floor(low[1]), raster.height), bottom = clipped(std::ceil(high[1]), raster.height);
      for (int row = top; row < bottom; ++row)
        for (int column = left; column < right; ++column) {
          const double gone = distance_to_segment({column + 0.5, row + 0.5}, from, to);
          const auto covered = static_cast<float>(std::clamp(reach - gone, 0.0, 1.0));
          float& pixel = cover[static_cast<std::size_t>(row) * raster.width + column];
          pixel = std::max(pixel, covered);
        }
    }
  // A line thinner than a pixel is paler, not wider.
  const double opacity = pen.opacity * std::min(1.0, pen.width);
  for (std::size_t i = 0; i < cover.size(); ++i)
    if (cover[i] > 0) raster.pixels[i] = blend(raster.pixels[i], pen.colour, opacity * cover[i]);
}

Strokes scaled(Strokes strokes, double factor) {
  for (Stroke& stroke : strokes)
    for (Vector<2>& point : stroke) point *= factor;
  return strokes;
}

}  // namespace saltus::drawing
