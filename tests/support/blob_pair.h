#pragma once

#include "core/grid/volume.h"

#include <cmath>

namespace saltus::testing_support {

/// A smooth 2-D scene of Gaussian blobs, `shift_mm` along world x from where it is at shift 0.
/// With fixed = scene(0) and moving = scene(s), the true displacement is (s, 0) everywhere.
inline Volume<2> blob_scene(int extent, double shift_mm, double spacing_mm = 1.5) {
  ImageGrid<2> grid;
  grid.size = {extent, extent};
  grid.spacing = Vector<2>::Constant(spacing_mm);
  grid.origin = Vector<2>(-20, 35);
  Volume<2> image(grid);
  const double length = extent * spacing_mm;
  for (int y = 0; y < extent; ++y)
    for (int x = 0; x < extent; ++x) {
      const Vector<2> at = spacing_mm * Vector<2>(x, y) - Vector<2>(shift_mm, 0);
      double value = 0;
      for (int blob = 0; blob < 25; ++blob) {
        // Off a lattice, of different heights and widths: only one place fits.
        const Vector<2> off(0.06 * (blob * 5 % 11 - 5), 0.06 * (blob * 3 % 11 - 5));
        const Vector<2> centre = length / 5 * (Vector<2>(blob % 5 + 0.5, blob / 5 + 0.5) + off);
        const double width = length / (16 + blob * 4 % 7);
        value += (40 + 7 * (blob * 7 % 11)) * std::exp(-(at - centre).squaredNorm() / (2 * width * width));
      }
      image.samples[static_cast<std::size_t>(y) * extent + x] = static_cast<float>(value);
    }
  return image;
}

}  // namespace saltus::testing_support
