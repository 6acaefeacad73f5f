#pragma once

#include "core/grid/image_grid.h"

namespace saltus {

/// Gives an ITK image the place and size of `grid`, without memory for its voxels. Includes nothing of ITK itself.
template <typename ItkImage, int Dim>
void set_geometry(ItkImage& image, const ImageGrid<Dim>& grid) {
  typename ItkImage::SizeType size;
  typename ItkImage::SpacingType spacing;
  typename ItkImage::PointType origin;
  typename ItkImage::DirectionType direction;
  for (int axis = 0; axis < Dim; ++axis) {
    size[axis] = grid.size[axis];
    spacing[axis] = grid.spacing[axis];
    origin[axis] = grid.origin[axis];
    for (int row = 0; row < Dim; ++row) direction(row, axis) = grid.direction(row, axis);
  }
  image.SetRegions(size);
  image.SetSpacing(spacing);
  image.SetOrigin(origin);
  image.SetDirection(direction);
}

}  // namespace saltus
