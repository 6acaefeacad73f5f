#pragma once

#include "core/drawing/raster.h"
#include "core/drawing/slice_plane.h"
#include "core/grid/volume.h"
#include "core/support/thread_count.h"

#include <vector>

namespace saltus::drawing {

/// At most about 200 000 of the samples, evenly spread: enough for the scale of a colour map.
template <class Value>
std::vector<double> thinned(std::size_t count, const Value& value) {
  const std::size_t step = count / 200'000 + 1;
  std::vector<double> values;
  for (std::size_t i = 0; i < count; i += step) values.push_back(value(i));
  return values;
}

/// The intensities that are shown as black and as white.
struct IntensityWindow {
  double low = 0, high = 1;
  double operator()(double intensity) const { return (intensity - low) / (high - low); }
};

/// From the 0.2 % to the 99.8 % quantile of the image; some width around them where they are the same.
template <int Dim>
IntensityWindow window_of(const Volume<Dim>& image);

/// The picture of a plane: `colour_at(index, column, row)` of the middle of every pixel, `index` continuous on `grid`.
/// Called by several threads at once.
template <int Dim, class ColourAt>
Raster paint(const SlicePlane<Dim>& plane, const ImageGrid<Dim>& grid, const ColourAt& colour_at) {
  Raster raster(plane.width, plane.height);
#pragma omp parallel for schedule(static) num_threads(threads_of_loop(raster.pixels.size()))
  for (int row = 0; row < plane.height; ++row)
    for (int column = 0; column < plane.width; ++column)
      raster.at(column, row) = colour_at(plane.index_at(column + 0.5, row + 0.5, grid), column, row);
  return raster;
}

}  // namespace saltus::drawing
