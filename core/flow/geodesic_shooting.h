#pragma once

#include "core/flow/coadjoint_transport.h"
#include "core/flow/scatter_plan.h"
#include "core/grid/resampling.h"
#include "core/momenta/momentum_scale.h"

#include <functional>
#include <memory>
#include <vector>

namespace saltus {

/// Initial momenta of all scales, or anything with their shape (gradients).
template <class T>
struct MomentumPointers {
  const T* zeroth = nullptr;  ///< null where the scale has no order 0
  const T* first = nullptr;   ///< Dim fields; null where it has no order 1
};
template <class T>
struct MomentumTargets {
  T* zeroth = nullptr;
  T* first = nullptr;
};

/// The geodesic that starts with given momenta, and its exact discrete adjoint.
///
/// Time is cut into `time_steps` equal steps. Momenta are transported in closed form (coadjoint_transport.h), each
/// scale by its own sites; v(t_k) is the sum over scales on the velocity lattice. Sites move with Heun's rule: the
/// velocity of the next node is made from the predicted positions, so one synthesis a step gives second order.
/// Memory: (time_steps + 1) velocity fields, 2 time_steps displacement fields for each scale.
template <int Dim, class T>
class GeodesicShooting {
 public:
  /// Scales stay owned by the caller and must outlive this.
  GeodesicShooting(std::vector<MomentumScale<Dim, T>*> scales, const Lattice<Dim>& velocity_lattice, int time_steps,
                   Evolution evolution);

  /// Called several times in each shoot and adjoint; may throw, which leaves this ready for another shoot.
  void on_work(std::function<void()> poll) { poll_ = std::move(poll); }

  int time_steps() const { return time_steps_; }
  const Lattice<Dim>& velocity_lattice() const { return lattice_; }

  /// Fills the velocities of all nodes. `blocks`, by scale (empty: all sites of all): outside them the first orders
  /// must be 0, and are left out of transport.
  void shoot(const std::vector<MomentumPointers<T>>& momenta, const std::vector<AxisBlocks<Dim>>& blocks = {});

  /// v(t_k), k = 0..time_steps, interleaved, mm per unit time.
  const std::vector<Field<T>>& velocities() const { return velocities_; }

  /// Sum over scales of 1/2 (rho | K rho) of the transported momenta at every node of the last shoot. With one scale it
  /// is the Hamiltonian and conserved; with several kernels each momentum goes its own way and it need not be.
  std::vector<double> hamiltonians(const std::vector<MomentumPointers<T>>& momenta);

  /// Adjoint of the last shoot. `velocity_duals` (dE/dv(t_k), modified) -> adds dE/dm to `gradient`; and adds to
  /// `preconditioned` (order 0 only) the same force without the outer kernel and cell volume: the V-gradient, with
  /// gradient = a_0 V K * preconditioned up to discretisation. `blocks` as for shoot: the gradient of first orders is
  /// complete inside them only.
  void adjoint(const std::vector<MomentumPointers<T>>& momenta, std::vector<Field<T>>& velocity_duals,
               const std::vector<MomentumTargets<T>>& gradient, const std::vector<MomentumTargets<T>>& preconditioned,
               const std::vector<AxisBlocks<Dim>>& blocks = {});

 private:
  struct ScaleState {
    MomentumScale<Dim, T>* scale;
    std::unique_ptr<CoadjointTransport<Dim, T>> transport;
    std::unique_ptr<LatticeInterpolation<Dim, T>> prolongation;
    std::vector<Field<T>> position;    ///< displacement of the sites at node k = 0..N-1; [0] empty, meaning 0
    std::vector<Field<T>> predicted;   ///< at node k = 1..N; [0] empty
    Field<T> zeroth, first, velocity;  ///< transported momenta and their velocity on the scale's lattice
  };
  void add_velocity(ScaleState& state, const T* zeroth, const T* first, const AxisFlags<Dim>& axes, Field<T>& velocity);
  void transported(ScaleState& state, const MomentumPointers<T>& momenta, const AxisBlocks<Dim>& blocks, int node);

  Lattice<Dim> lattice_;
  int time_steps_;
  std::vector<ScaleState> states_;
  std::vector<Field<T>> velocities_;
  ScatterPlan<Dim, T> plan_;
  std::function<void()> poll_;
};

}  // namespace saltus
