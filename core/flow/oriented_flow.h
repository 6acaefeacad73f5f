#pragma once

#include "core/flow/element_transport.h"
#include "core/grid/resampling.h"
#include "core/momenta/oriented_momenta.h"

#include <memory>
#include <vector>

namespace saltus {

/// The oriented momenta of one scale along the flow of geodesic_shooting.h, and the adjoint of that. Points of elements
/// move with Heun's rule, as sites do there. With evolution `carried` they are the elements' corners, and carry momenta
/// whose coordinates in the element's own axes stay what they are, turned with the plane; with the others they tell
/// what element_transport.h makes of elements. Calls come in the order of the flow's nodes,
/// 0 <= k <= time steps; `velocity` is v(t_k) on the velocity lattice.
template <int Dim, class T>
class OrientedFlow {
 public:
  using Element = typename OrientedMomenta<Dim, T>::Element;

  /// `momenta` must outlive this.
  OrientedFlow(OrientedMomenta<Dim, T>& momenta, const Lattice<Dim>& velocity_lattice, int time_steps,
               Evolution evolution);

  /// Begins a flow with these elements, which must live until its adjoint is done, with `values` of them.
  void begin(const std::vector<Element>* elements, const T* values);
  bool is_empty() const { return !elements_ || elements_->empty(); }

  /// velocity += what elements make at node k. At node k > 0 they are where `predict` left them.
  void add_velocity(int k, T* velocity);
  /// From node k: where elements will be at node k + 1, to first order.
  void predict(int k, const T* velocity, T dt);
  /// Where they are at node k > 0, to second order; not at the last node, where nothing needs it.
  void correct(int k, const T* velocity, T dt);

  /// OrientedMomenta::energy at node k of the last flow, whose values must still live. Throws InvalidInput with
  /// evolution `carried`, which has none.
  double energy(int k);

  /// The adjoints, for k from the last node down, each of what bears its name; `begin_adjoint` empties all duals.
  void begin_adjoint();
  void correct_adjoint(int k, const T* velocity, T dt, T* velocity_dual);
  void add_velocity_adjoint(int k, const T* velocity_dual, T* values_dual);
  void predict_adjoint(int k, const T* velocity, T dt, T* velocity_dual);

 private:
  const std::vector<T>& points_at(int k) const { return k == 0 ? position_[0] : predicted_[k]; }

  OrientedMomenta<Dim, T>& momenta_;
  Lattice<Dim> lattice_;  ///< of the velocity
  LatticeInterpolation<Dim, T> prolongation_;
  Field<T> own_;  ///< velocity, or its dual, on the momenta's lattice; empty where prolongation is the identity
  const std::vector<Element>* elements_ = nullptr;
  const T* values_ = nullptr;
  std::unique_ptr<ElementTransport<Dim, T>> transport_;  ///< null with evolution `carried`
  std::vector<TransportedElement<Dim, T>> transported_, transported_duals_;
  std::vector<Element> placed_;                       ///< whose points at time 0 are known
  std::size_t placed_after_ = 0;                      ///< as many turns
  std::vector<std::vector<T>> position_, predicted_;  ///< points by node; predicted_[0] is not used
  std::vector<T> position_dual_, predicted_dual_, through_velocity_;
};

}  // namespace saltus
