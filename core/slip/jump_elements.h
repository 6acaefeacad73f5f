#pragma once

#include "core/flow/geodesic_shooting.h"
#include "core/momenta/momentum_scale.h"

#include <vector>

namespace saltus {

/// What one first-order momentum adds to the singular part [v] n^T delta of D v. Positions: mm in the frame.
template <int Dim>
struct JumpElement {
  Vector<Dim> at;
  Vector<Dim> normal;
  Vector<Dim> strength;  ///< integral of [v] over its plane, mm^Dim per unit time
};

/// How [v] falls over the plane of an element: as the product of k0(r_j), C0 Wendland of this width, for the
/// coordinates in the plane; and what share of the strength does.
struct JumpSpread {
  double width_mm = 1, share = 1;
};

/// Those of one kernel, whose jump spreads as the parts of that do that jump.
template <int Dim>
struct JumpElements {
  Lattice<Dim> lattice;             ///< on which the momenta live
  std::vector<JumpSpread> spreads;  ///< of shares that sum to 1
  std::vector<JumpElement<Dim>> list;
  int axis = -1;  ///< the normal of all of them is this axis of the frame; -1: each has its own

  double widest_mm() const;
};

/// The jumps of a scale's initial velocity: of the m_i, at the faces they lie on, and of its oriented momenta. The
/// derivative of k0 falls by 2 |k0'(0+)| at 0, so that a momentum m in cells of volume V makes v jump, over its plane,
///
///     integral of [v] = a_1 V w_q (sigma / mass_q) 2 k0_q'(0+) m         (-6 a_1 V / sigma m for one C0 Wendland).
///
/// Momenta below a thousandth of the largest of their field, and those of kernels that are smooth at 0, are not listed.
/// One list for each axis, whose strength is the sum over the parts q of the kernel, and one for the oriented momenta.
template <int Dim, class T>
std::vector<JumpElements<Dim>> jump_elements(const MomentumScale<Dim, T>& scale, const MomentumPointers<T>& momenta);

}  // namespace saltus
