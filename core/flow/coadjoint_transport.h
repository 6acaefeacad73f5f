#pragma once

#include "core/flow/evolution.h"
#include "core/flow/moved_sites.h"
#include "core/grid/lattice.h"
#include "core/momenta/block_set.h"

namespace saltus {

/// Ad* of the flow on the momenta of one scale, in closed form (no EPDiff equation is integrated).
///
/// Order 0 sits at the sites, the first-order momentum m_c at the faces half a sample up axis c (momentum_scale.h). An
/// element at x0 is the functional w -> m_0 . w (order 0) or w -> -unit m_c . d_c w (order 1); with the flow
/// phi(x0) = x0 + d(x0), F = D phi and G = F^-T it becomes, at phi(x0),
///
///     m_0' = G m_0                                                                    from order 0
///     m_b' = F_bc G m_c  for all axes b,   m_0' = unit G (d_c F)^T G m_c              from order 1
///
/// and is spread with the transpose of linear interpolation, which carries |det F| by itself.
///
/// F and d_c F are jump-aware differences of d at the sites (jump_aware_jacobian.h). At a face, position, F and d_c F
/// are the means of the two sites beside it, each differentiated on its own side: a sheet moves with the mean of both
/// sides, and not with the derivative of its own jump, which does not exist as the grid is refined.
///
/// That is evolution `exact`. With `per_order` each m_c only turns with G; with `carried` F is replaced by the
/// identity.
///
/// Not for concurrent use; threads inside. Results do not depend on the number of threads. Where the sites are, each
/// call takes from a MovedSites of the same lattice and evolution that has been moved around all blocks of the call.
template <int Dim, class T>
class CoadjointTransport {
 public:
  /// `unit` is MomentumScale::first_order_unit; orders as there.
  CoadjointTransport(const Lattice<Dim>& lattice, double unit, bool has_zeroth, bool has_first, Evolution evolution);

  /// Where first orders that start in `blocks`, and order 0, are spread to.
  MomentumMasks<Dim> reached(const MovedSites<Dim, T>& sites, const AxisBlocks<Dim>& blocks) const;

  /// Momenta at time t from those at 0. Outside `blocks` (of the start) the first orders must be 0 and are not read;
  /// outside `reached`, which is that of the same sites and blocks, zeroth_out and first_out are not written.
  void push(MovedSites<Dim, T>& sites, const T* zeroth, const T* first, const AxisBlocks<Dim>& blocks,
            const MomentumMasks<Dim>& reached, T* zeroth_out, T* first_out);

  /// Adjoint of push: given the duals of zeroth_out and first_out, of which it reads what `reached` tells for `wanted`,
  /// adds to displacement_dual, zeroth_dual and first_dual, to the last in `wanted` only (outside, first must be 0;
  /// null: it is 0 everywhere), and to the duals of the Jacobians, for MovedSites::end_adjoint.
  void push_adjoint(MovedSites<Dim, T>& sites, const T* zeroth, const T* first, const AxisBlocks<Dim>& wanted,
                    const T* zeroth_out_dual, const T* first_out_dual, T* displacement_dual, T* zeroth_dual,
                    T* first_dual);

  /// sum += scale * F^-1 field(phi(x0)) at the sites: the order-0 part of push_adjoint, for another dual field.
  void pull_back(const MovedSites<Dim, T>& sites, const T* field, T scale, T* sum) const;

 private:
  struct Face;
  void push_faces(MovedSites<Dim, T>& sites, int axis, const BlockSet<Dim>* blocks, const T* first, T* zeroth_out,
                  T* first_out);
  void zeroth_adjoint(MovedSites<Dim, T>& sites, const T* zeroth, const T* dual_field, T* displacement_dual,
                      T* zeroth_dual);
  void face_adjoint(MovedSites<Dim, T>& sites, int axis, const BlockSet<Dim>* blocks, const T* first,
                    const T* zeroth_out_dual, const T* first_out_dual, T* displacement_dual, T* first_dual);
  void carried_face_adjoint(const MovedSites<Dim, T>& sites, int axis, const BlockSet<Dim>* blocks, const T* first,
                            const T* out_dual, T* displacement_dual, T* first_dual);
  /// visit(index, site) for the sites of a slab that are in `blocks` (null: all).
  template <class Visit>
  void visit_slab_of(const BlockSet<Dim>* blocks, int slab, Visit&& visit) const;

  Lattice<Dim> lattice_;
  T unit_;
  Evolution evolution_;
  bool has_zeroth_, has_first_;
};

}  // namespace saltus
