#pragma once

#include "core/flow/evolution.h"
#include "core/momenta/oriented_momenta.h"

#include <vector>

namespace saltus {

/// Ad* of the flow on elements of oriented momenta, in closed form, as coadjoint_transport.h does it for momenta along
/// the axes: with F = D phi and G = F^-T at x, the functional w -> -sigma m . d_n w becomes, at phi(x),
///
///     w -> m_0 . w - sigma m_1 . (N . grad) w    with  N = F n,  m_1 = G m,  m_0 = sigma G (d_n F)^T G m
///
/// with evolution `exact`, and with N = n, m_0 = 0 with `per_order`; sigma is the width along n. Of F each side of the
/// element is asked by itself, by points half a cell away from it and two cells (along n: one) around there, and F is
/// the mean of both: the element's own jump is not differentiated. d_n F is what both sides say of F, over their
/// distance. So both are right to second order in the cell where the flow is smooth.
///
/// Kernels do not turn: with the norm of one kernel K_n, elements move along its geodesics and H = 1/2 (rho | K_n rho)
/// is conserved, as far as the lattice resolves the momentum; a sheet as thin as a cell it does not, whose H is
/// infinite in the limit (core/measurements.md). With several kernels, or one that turns, each momentum goes its
/// own way through a velocity that all share, and nothing of this kind is conserved: with v_n = K_n rho_n and the
/// bracket [v, w] = Dv w - Dw v, H changes at the rate of sum over n < m of (rho_n - rho_m | [v_n, v_m]).
template <int Dim, class T>
class ElementTransport {
 public:
  using Oriented = OrientedMomenta<Dim, T>;
  using Element = typename Oriented::Element;
  static constexpr int kPoints = 2 * Dim;                 ///< on each side of an element
  static constexpr int kPointValues = 2 * kPoints * Dim;  ///< their coordinates, side after side

  /// Throws InvalidInput for evolution `carried`, which corners of elements do (oriented_flow.h).
  ElementTransport(const Oriented& momenta, Evolution evolution);

  /// Points of elements at time 0, mm in the frame.
  void place(const std::vector<Element>& elements, std::vector<T>& points);
  /// What became of the elements last placed, with momenta `values`, once the flow has moved their points.
  void transport(const std::vector<T>& points, const T* values, std::vector<TransportedElement<Dim, T>>& out) const;
  /// Its adjoint: adds to the duals of the momenta and of the points (null: not).
  void adjoint(const std::vector<T>& points, const T* values, const std::vector<TransportedElement<Dim, T>>& duals,
               T* values_dual, T* points_dual) const;

 private:
  using Square = Eigen::Matrix<T, Dim, Dim>;
  using Column = Eigen::Matrix<T, Dim, 1>;
  struct Moved;
  Moved moved(std::size_t element, const T* points, const T* values) const;

  const Oriented& momenta_;
  bool turns_;  ///< the derivative; exact
  T sigma_;
  std::vector<Eigen::Matrix<T, Dim, Dim, Eigen::DontAlign>> axes_;  ///< rows: n, t_1, .. at time 0
  std::vector<Eigen::Matrix<T, Dim, 1, Eigen::DontAlign>> cell_;    ///< width along these
};

}  // namespace saltus
