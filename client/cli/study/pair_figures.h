#pragma once

#include "client/cli/study/figure.h"
#include "core/drawing/slice_plane.h"
#include "core/grid/volume.h"

#include <optional>
#include <string>
#include <vector>

namespace saltus::cli {

/// What one model found, on the fixed grid.
template <int Dim>
struct ModelResult {
  std::string name;
  VectorVolume<Dim> displacement;  ///< world mm
  Volume<Dim> warped;              ///< the moving image on the fixed grid
};

/// A pair of images and what the models made of it. The paper's template is the moving image, its reference the fixed.
template <int Dim>
struct PairResults {
  std::string name;
  Volume<Dim> fixed, moving;
  std::optional<VectorVolume<Dim>> truth;
  std::vector<ModelResult<Dim>> models;
};

/// The plane in which a pair is shown: of a volume that with the most voxels, through the slice over which the gradient
/// of `displacement`, summed, is largest.
template <int Dim>
drawing::SlicePlane<Dim> main_plane(const VectorVolume<Dim>& displacement);

/// As the paper's figures of rectangle and wheel, a column for each model: deformed template, displacement magnitude
/// (one scale for all), deformed grid; before them template, reference and the grid of the true displacement.
template <int Dim>
drawing::Raster deformation_sheet(const PairResults<Dim>& pair, const drawing::SlicePlane<Dim>& plane);

/// As the paper's figure of the lung: template, and the deformed templates with the displacement as red arrows;
/// reference, and the displacement magnitudes.
template <int Dim>
drawing::Raster field_sheet(const PairResults<Dim>& pair, const drawing::SlicePlane<Dim>& plane);

/// As the paper's differences before and after registration: template or deformed template minus reference, on one
/// scale.
template <int Dim>
drawing::Raster difference_sheet(const PairResults<Dim>& pair, const drawing::SlicePlane<Dim>& plane);

}  // namespace saltus::cli
