#pragma once

#include "core/flow/scatter_plan.h"
#include "core/grid/lattice.h"

#include <vector>

namespace saltus {

/// Ad* of the flow on the momenta of one scale, in closed form (no EPDiff equation is integrated). A site x0 carries
/// the functional w -> m_0 . w - unit * sum_b m_b . d_b w; with phi(x0) = x0 + d(x0) and F = D phi it becomes, at phi(x0),
///
///     m_b' = F^-T sum_c m_c F_bc
///     m_0' = F^-T ( m_0 + unit * sum_b (d_b F)^T F^-T m_b )
///
/// and is spread to the lattice with the transpose of linear interpolation, which carries |det F| by itself.
/// F and d_b F are jump-aware differences of d (jump_aware_jacobian.h): at an active first-order site the map jumps,
/// and a sheet of momentum moves with the derivative of its own side, not with that of its own jump.
///
/// Not for concurrent use; threads inside. Results do not depend on the number of threads.
template <int Dim, class T>
class CoadjointTransport {
 public:
  /// `unit` is MomentumScale::first_order_unit; orders as there.
  CoadjointTransport(const Lattice<Dim>& lattice, double unit, bool has_zeroth, bool has_first);

  /// Momenta at time t from those at 0 and the displacement d (mm, interleaved) of the sites since then.
  /// zeroth_out is always written; first_out when there is a first order.
  void push(const T* displacement, const T* zeroth, const T* first, T* zeroth_out, T* first_out);

  /// Adjoint of the last push with the same arguments: given the duals of zeroth_out and first_out, adds to
  /// displacement_dual, zeroth_dual and first_dual.
  void push_adjoint(const T* displacement, const T* zeroth, const T* first, const T* zeroth_out_dual,
                    const T* first_out_dual, T* displacement_dual, T* zeroth_dual, T* first_dual);

  /// Adds F^T-free pull back F^-1-transported values of a covector field: sum += F^-1-adjoint of `field` at phi(x0).
  /// The order-0 part of push_adjoint with another dual; used for the preconditioned gradient.
  void pull_back(const T* displacement, const T* field, T scale, T* sum);

 private:
  struct Site;
  void jacobians(const T* displacement);

  Lattice<Dim> lattice_;
  T unit_;
  bool has_zeroth_, has_first_;
  std::array<std::size_t, Dim> stride_;
  ScatterPlan<Dim, T> plan_;
  std::vector<T> jacobian_;       ///< F per site, row-major
  std::vector<T> jacobian_dual_;
};

}  // namespace saltus
