#pragma once

#include "core/drawing/slice_plane.h"
#include "server/worker/report/report.h"

#include <cstddef>
#include <string>

namespace saltus::report {

/// Landmarks near a slice, over a picture of it.
struct LandmarkMarks {
  std::string svg;        ///< elements in picture pixels
  std::size_t shown = 0;  ///< landmarks whose place lies in the picture and near enough to the slice
};

/// How far off a slice, mm, a landmark is still shown with it: a twentieth of the image's extent across, at least one
/// voxel. Infinite in 2-D.
template <int Dim>
double landmark_reach_mm(const ImageGrid<Dim>& fixed, const drawing::SlicePlane<Dim>& plane);

/// Over the fixed image: a ring at each fixed landmark p.
template <int Dim>
LandmarkMarks fixed_landmark_marks(const ReportInput<Dim>& input, const drawing::SlicePlane<Dim>& plane);

/// Over the moving image as it lies on the fixed grid (after the affine start): a ring where the moving landmark q is,
/// a dot where the displacement carries p, and between them a line, the error. Its colour is that of `interface_colour`
/// on a scale up to `most_mm`.
template <int Dim>
LandmarkMarks carried_landmark_marks(const ReportInput<Dim>& input, const drawing::SlicePlane<Dim>& plane,
                                     double most_mm);

}  // namespace saltus::report
