#pragma once

#include "core/flow/evolution.h"
#include "core/flow/scatter_plan.h"
#include "core/grid/lattice.h"
#include "core/momenta/block_set.h"

#include <Eigen/Core>

#include <vector>

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
/// Not for concurrent use; threads inside. Results do not depend on the number of threads.
template <int Dim, class T>
class CoadjointTransport {
 public:
  /// `unit` is MomentumScale::first_order_unit; orders as there.
  CoadjointTransport(const Lattice<Dim>& lattice, double unit, bool has_zeroth, bool has_first, Evolution evolution);

  /// Momenta at time t from those at 0 and the displacement d (mm, interleaved) of the sites since then.
  /// zeroth_out is always written; first_out when there is a first order. Outside `blocks` (of the start) the first
  /// orders must be 0 and are not read; fields of first_out that are not in reached_axes stay as they are.
  void push(const T* displacement, const T* zeroth, const T* first, T* zeroth_out, T* first_out,
            const AxisBlocks<Dim>& blocks = {});

  /// Axes along which there are first orders later when there are some along those of `start` at the start.
  AxisFlags<Dim> reached_axes(const AxisFlags<Dim>& start) const;

  /// Adjoint of push with the same arguments: given the duals of zeroth_out and first_out, adds to displacement_dual,
  /// zeroth_dual and first_dual, to the last in `blocks` only (outside, first must be 0). Of first_out_dual the fields
  /// in reached_axes are read.
  void push_adjoint(const T* displacement, const T* zeroth, const T* first, const T* zeroth_out_dual,
                    const T* first_out_dual, T* displacement_dual, T* zeroth_dual, T* first_dual,
                    const AxisBlocks<Dim>& blocks = {});

  /// sum += scale * F^-1 field(phi(x0)) at the sites: the order-0 part of push_adjoint, for another dual field. Uses
  /// the Jacobians of the last push or push_adjoint, which must have had the same displacement.
  void pull_back(const T* displacement, const T* field, T scale, T* sum);

 private:
  struct Face;
  using Inverse = Eigen::Matrix<T, Dim, Dim, Eigen::RowMajor | Eigen::DontAlign>;
  Inverse inverse_jacobian(std::size_t site) const;
  void find_jacobians(const T* displacement);
  /// visit(index, site) for the sites of a slab that are in `blocks` (null: all).
  template <class Visit>
  void visit_slab_of(const BlockSet<Dim>* blocks, int slab, Visit&& visit) const;
  void push_faces(int axis, const BlockSet<Dim>* blocks, const T* displacement, const T* first, T* zeroth_out,
                  T* first_out);
  void zeroth_adjoint(const T* displacement, const T* zeroth, const T* dual_field, T* displacement_dual,
                      T* zeroth_dual);
  void face_adjoint(int axis, const BlockSet<Dim>* blocks, const T* displacement, const T* first,
                    const T* zeroth_out_dual, const T* first_out_dual, T* displacement_dual, T* first_dual);

  Lattice<Dim> lattice_;
  T unit_;
  Evolution evolution_;
  bool has_zeroth_, has_first_;
  std::array<std::size_t, Dim> stride_;
  ScatterPlan<Dim, T> plan_;
  std::vector<T> jacobian_;  ///< F per site, row-major
  std::vector<T> jacobian_dual_;
};

}  // namespace saltus
