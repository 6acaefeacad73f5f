#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "core/grid/volume.h"

namespace saltus {

/// Nearest keeps labels; BSpline is cubic and may overshoot beside edges.
enum class Interpolation { Linear, Nearest, BSpline };

std::string to_string(Interpolation interpolation);
/// linear, nearest or bspline. Throws InvalidInput that lists them.
Interpolation parse_interpolation(std::string_view text);

struct WarpOptions {
  Interpolation interpolation = Interpolation::Linear;
  std::optional<float> outside = {};  ///< value of points beyond the image's voxels; none: the nearest border's value
};

/// image(x + u(x)) at each voxel x of the displacement's grid: with `displacement` the moving image on the fixed grid,
/// with `inverse_displacement` the fixed image on the moving grid. The image may have any other grid.
template <int Dim>
Volume<Dim> warp_image(const Volume<Dim>& image, const VectorVolume<Dim>& displacement,
                       const WarpOptions& options = {});

}  // namespace saltus
