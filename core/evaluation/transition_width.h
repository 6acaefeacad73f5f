#pragma once

#include <cstddef>
#include <vector>

#include "core/grid/volume.h"

namespace saltus {

/// A place of a sliding interface in the fixed image, world mm. `normal` and `tangent` have length 1; the tangential
/// displacement u . tangent grows from the side that the normal leaves to the side that it points to.
template <int Dim>
struct InterfacePoint {
  Vector<Dim> position = Vector<Dim>::Zero();
  Vector<Dim> normal = Vector<Dim>::Zero();
  Vector<Dim> tangent = Vector<Dim>::Zero();
};

/// How a displacement jumps across an interface: medians over the points.
struct TransitionWidth {
  std::size_t points = 0;
  std::size_t resolved = 0;  ///< points where a transition was found; the others show no jump along their tangent
  double width_mm = 0;       ///< of the resolved points; 0 when there are none
  double jump_mm = 0;        ///< difference of the levels, all points
};

/// The 10-90 % transition width of the jump of u . tangent. Along the line position + r normal, |r| <= reach_mm, the
/// two levels are the means over the outer third of each side; the width is the distance between the places where the
/// profile, followed from its half level next to the interface, first reaches 10 % and 90 % of the way from level to
/// level. u is linear between voxels, so a jump between two neighbouring samples of spacing h has the width 0.8 h along
/// an axis; no sampled field has less.
///
/// Points whose line leaves the field's grid do not count. Throws InvalidInput when reach_mm is not positive.
template <int Dim>
TransitionWidth transition_width(const VectorVolume<Dim>& displacement, const std::vector<InterfacePoint<Dim>>& points,
                                 double reach_mm);

/// Mean normal jump of a displacement relative to the true one, mm, between places `reach_mm` off the interface on both
/// sides. psi = x + u carries fixed to moving points: where it opens (u . normal jumps by more than the truth), moving
/// tissue is missing in the fixed image, and where it closes, moving tissue is shown twice.
struct NormalJump {
  std::size_t points = 0;
  double opening_mm = 0;  ///< mean of the positive parts
  double closing_mm = 0;  ///< mean of the negative parts, as a positive number
};

/// Throws InvalidInput when the grids differ or reach_mm is not positive.
template <int Dim>
NormalJump normal_jump(const VectorVolume<Dim>& displacement, const VectorVolume<Dim>& truth,
                       const std::vector<InterfacePoint<Dim>>& points, double reach_mm);

}  // namespace saltus
