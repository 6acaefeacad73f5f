#pragma once

#include "core/drawing/slice_plane.h"
#include "core/evaluation/jacobian.h"
#include "server/worker/report/interface.h"
#include "server/worker/report/measures.h"
#include "server/worker/report/report.h"

#include <optional>
#include <vector>

namespace saltus::report {

/// What both documents tell, measured once from a finished registration.
template <int Dim>
struct Analysis {
  std::optional<LandmarkMeasures> landmarks;  ///< none were given: empty
  DisplacementMeasures displacement;
  JacobianStatistics jacobian;
  DetectedInterface<Dim> interface;
  /// Whether first-order momenta take part. Without them the motion is smooth, and what `interface` holds is change
  /// that the voxels are too coarse to tell from a jump.
  bool may_slide = false;
  SlipSummary slip;                           ///< of the result's slip surface
  std::optional<Vector<Dim>> strongest_slip;  ///< continuous index; empty: nothing slides
  FoldedVoxels folded;
  double share_beyond_moving = 0;  ///< of the fixed voxels whose x + u(x) lies outside the moving image
};

/// Throws InvalidInput when the numbers of landmarks differ.
template <int Dim>
Analysis<Dim> analyse(const ReportInput<Dim>& input);

}  // namespace saltus::report
