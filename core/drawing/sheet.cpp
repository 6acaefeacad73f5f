#include "core/drawing/sheet.h"

#include "core/drawing/lettering.h"

#include <algorithm>

namespace saltus::drawing {
namespace {

constexpr int margin = 16, panel_gap = 18, caption_height = 24, scale_height = 56;
constexpr double caption_size = 10, scale_size = 8;

void put(Raster& onto, const Raster& picture, int left, int top) {
  for (int row = 0; row < picture.height; ++row)
    for (int column = 0; column < picture.width; ++column) onto.at(left + column, top + row) = picture.at(column, row);
}

void put_scale(Raster& onto, const ColourScale& scale, int left, int top, int width) {
  const int high = 9;
  for (int row = 0; row < high; ++row)
    for (int column = 0; column < width; ++column)
      onto.at(left + column, top + row) = scale.colour_at(column / std::max(1.0, width - 1.0));
  const TextAnchor anchors[] = {TextAnchor::Start, TextAnchor::Middle, TextAnchor::End};
  for (int i = 0; i < 3; ++i)
    write(onto, scale.texts[i], {left + width * i / 2.0, top + high + 14.0},
          {.height = scale_size, .anchor = anchors[i]});
  write(onto, scale.unit, {left + width / 2.0, top + high + 28.0},
        {.height = scale_size, .colour = {98, 104, 111}, .anchor = TextAnchor::Middle});
}

}  // namespace

Raster magnified(const Raster& raster, int factor) {
  Raster large(raster.width * factor, raster.height * factor);
  for (int row = 0; row < large.height; ++row)
    for (int column = 0; column < large.width; ++column)
      large.at(column, row) = raster.at(column / factor, row / factor);
  return large;
}

Raster sheet(const std::vector<std::vector<SheetPanel>>& rows) {
  // A row without captions has no room for them.
  const auto above = [](const std::vector<SheetPanel>& row) {
    return std::any_of(row.begin(), row.end(), [](const SheetPanel& panel) { return !panel.caption.empty(); })
               ? caption_height
               : 0;
  };
  std::vector<int> widths;
  int height = margin;
  for (const auto& row : rows) {
    int tallest = 0;
    bool has_scale = false;
    for (std::size_t i = 0; i < row.size(); ++i) {
      if (widths.size() <= i) widths.push_back(0);
      const double caption = text_width(row[i].caption, caption_size);
      widths[i] = std::max({widths[i], row[i].picture.width, static_cast<int>(caption) + 1});
      tallest = std::max(tallest, row[i].picture.height);
      has_scale = has_scale || row[i].scale;
    }
    height += above(row) + tallest + (has_scale ? scale_height : panel_gap);
  }
  int width = 2 * margin - panel_gap;
  for (int one : widths) width += one + panel_gap;
  Raster whole(width, height);
  std::fill(whole.pixels.begin(), whole.pixels.end(), Colour{255, 255, 255});
  int top = margin;
  for (const auto& row : rows) {
    int left = margin, tallest = 0;
    bool has_scale = false;
    for (std::size_t i = 0; i < row.size(); left += widths[i] + panel_gap, ++i) {
      const SheetPanel& panel = row[i];
      if (panel.picture.pixels.empty()) continue;
      const double middle = left + panel.picture.width / 2.0;
      write(whole, panel.caption, {middle, top + 14.0}, {.height = caption_size, .anchor = TextAnchor::Middle});
      put(whole, panel.picture, left, top + above(row));
      if (panel.scale)
        put_scale(whole, *panel.scale, left, top + above(row) + panel.picture.height + 6, panel.picture.width);
      tallest = std::max(tallest, panel.picture.height);
      has_scale = has_scale || panel.scale;
    }
    top += above(row) + tallest + (has_scale ? scale_height : panel_gap);
  }
  return whole;
}

}  // namespace saltus::drawing
