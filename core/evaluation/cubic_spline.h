#pragma once

#include <vector>

#include "core/grid/volume.h"

namespace saltus {

/// Cubic B-spline through the samples of an image, mirrored at the border voxels' centres.
/// Source: Unser, Aldroubi, Eden, "B-spline signal processing", IEEE TSP 1993 (recursive prefilter, pole sqrt(3) - 2).
template <int Dim>
class CubicSpline {
 public:
  explicit CubicSpline(const Volume<Dim>& image);

  /// Value at a continuous index within [0, size - 1] of each axis. Reproduces the samples, up to rounding.
  double operator()(const Vector<Dim>& index) const;

 private:
  Index<Dim> size_;
  std::vector<double> coefficients_;
};

}  // namespace saltus
