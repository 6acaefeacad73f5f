#pragma once

#include "core/grid/image_grid.h"

namespace saltus {

/// Breathing of one side of the thorax: a column of curved cross-section (lung above, abdomen below) that glides along
/// the wall. Organ coordinates q = (xi, eta, zeta): the column is xi^2 + eta^2 < 1, zeta is world z, and
///
///     y = cy + s(zeta) b eta,   x = side (cx(zeta) + s(zeta) (a xi - bend eta^2)),   z = zeta.
///
/// The motion keeps xi^2 + eta^2, so it is tangential to the wall everywhere and neither opens a gap nor overlaps:
///
///     zeta' = zeta - A W(xi, eta) g(zeta),   (xi', eta') = R(alpha(xi^2 + eta^2) g(zeta')) (xi, eta).
///
/// g is 0 above the level `still_above_mm` (apex) and 1 below the diaphragm. World points are mm, LPS, centred.
class LungMotion {
 public:
  enum class Side { Right, Left };  ///< the patient's; right is at negative x

  /// `body_mm`: semi-axes of the body in x and y; `height_mm` of the image.
  LungMotion(Side side, const Vector<2>& body_mm, double height_mm, double displacement_mm);

  Vector<3> to_organ(const Vector<3>& world) const;
  Vector<3> to_world(const Vector<3>& organ) const;

  /// Fixed (exhale) -> moving (inhale), in organ coordinates, for points of the column.
  Vector<3> to_moving(const Vector<3>& organ) const;
  Vector<3> to_fixed(const Vector<3>& organ) const;
  /// Volume in the moving image per volume in the fixed image, at a point of the fixed image.
  double jacobian(const Vector<3>& organ) const;

  /// First-order signed distance from the column's wall, mm, negative inside; accurate near the wall.
  double wall_distance(const Vector<3>& world) const;

  double still_above_mm() const { return still_above_; }
  double apex_mm() const { return apex_; }
  /// Upper end of the lung at that place of the cross-section: a rounded cap that does not move.
  double cap(const Vector<3>& organ) const;
  /// Height of the diaphragm in the moving image.
  double diaphragm(const Vector<3>& organ) const;
  /// Whether a point of the moving image belongs to the lung.
  bool is_lung(const Vector<3>& organ) const;

 private:
  double taper(double zeta) const;
  double centre_x(double zeta) const;
  double ramp(double zeta) const;
  double ramp_slope(double zeta) const;
  double amount(double xi, double eta) const;
  double turn(double squared_radius, double zeta) const;

  double side_;
  double displacement_;
  double height_;
  double centre_across_, centre_y_, half_width_, half_depth_, bend_;
  double apex_, still_above_, full_below_;
  double amount_scale_ = 1;
};

}  // namespace saltus
