#pragma once

#include "core/drawing/slice_plane.h"
#include "core/drawing/strokes.h"
#include "core/grid/volume.h"

#include <string>

namespace saltus::drawing {

/// Both give lines in picture pixels. Of a 3-D displacement the part within the plane is shown.

/// The lines of a regular grid of the plane, carried along by x -> x + u(x).
template <int Dim>
Strokes deformed_grid_lines(const VectorVolume<Dim>& displacement, const SlicePlane<Dim>& plane);

/// Arrows along u at regular points of the plane; one of `longest_mm` is nearly as long as the points are apart.
template <int Dim>
Strokes arrow_lines(const VectorVolume<Dim>& displacement, const SlicePlane<Dim>& plane, double longest_mm);

/// The `d` of an SVG path of these lines.
std::string svg_path(const Strokes& strokes);

}  // namespace saltus::drawing
