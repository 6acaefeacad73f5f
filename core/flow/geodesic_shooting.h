#pragma once

#include "core/flow/coadjoint_transport.h"
#include "core/flow/moved_sites.h"
#include "core/flow/oriented_flow.h"
#include "core/grid/resampling.h"
#include "core/momenta/momentum_scale.h"

#include <functional>
#include <memory>
#include <vector>

namespace saltus {

/// Initial momenta of all scales, or anything with their shape (gradients).
template <class T>
struct MomentumPointers {
  const T* zeroth = nullptr;                             ///< null where the scale has no order 0
  const T* first = nullptr;                              ///< Dim fields; null where it has no order 1
  const std::vector<std::uint32_t>* elements = nullptr;  ///< of the scale's oriented momenta; null: none of them
  const T* oriented = nullptr;                           ///< their values
};
template <class T>
struct MomentumTargets {
  T* zeroth = nullptr;
  T* first = nullptr;
  T* oriented = nullptr;  ///< of the elements that were shot
};

/// What counts of the first orders, by scale; empty: all of all.
template <int Dim>
struct ActiveBlocks {
  std::vector<AxisBlocks<Dim>> momenta;  ///< outside, momenta are 0 and not read
  std::vector<AxisBlocks<Dim>> wanted;   ///< the gradient is made in these, which hold those of the momenta
};

/// The geodesic that starts with given momenta, and its exact discrete adjoint.
///
/// Time is cut into `time_steps` equal steps. Momenta are transported in closed form (coadjoint_transport.h), each
/// scale by its own sites; v at the steps' ends is the sum over scales on the velocity lattice. Sites move with Heun's
/// rule: the velocity of the next end is made from the predicted positions, so one synthesis a step gives second order.
/// Oriented momenta go as oriented_flow.h tells.
/// Scales on one lattice share its sites; where none of them has an order 0, only sites around active blocks move.
///
/// Maps may need shorter steps than momenta: x - dt v(x) is one to one only where dt |D v| < 1. So each step is cut
/// into `map_steps`, between whose ends v is linear in time, at the cost of a mean instead of a synthesis.
/// Memory: (time_steps map_steps + 1) velocity fields, 2 time_steps displacement fields for each lattice.
template <int Dim, class T>
class GeodesicShooting {
 public:
  /// Scales stay owned by the caller and must outlive this.
  GeodesicShooting(std::vector<MomentumScale<Dim, T>*> scales, const Lattice<Dim>& velocity_lattice, int time_steps,
                   Evolution evolution, int map_steps = 1);

  /// Called several times in each shoot and adjoint; may throw, which leaves this ready for another shoot.
  void on_work(std::function<void()> poll) { poll_ = std::move(poll); }

  int nodes() const { return time_steps_ * map_steps_ + 1; }  ///< at which there are velocities
  const Lattice<Dim>& velocity_lattice() const { return lattice_; }

  /// What a scale of order 0 alone makes of its momenta at time 0, everywhere on its lattice, without its oriented
  /// momenta: MomentumScale::synthesise of them.
  using StartingVelocity = std::function<void(std::size_t scale, const T* velocity)>;

  /// Fills the velocities of all nodes. `blocks` must live until the adjoint is done. `on_start` is told of each scale
  /// of order 0 alone what is synthesised of it anyhow.
  void shoot(const std::vector<MomentumPointers<T>>& momenta, const ActiveBlocks<Dim>& blocks = {},
             const StartingVelocity& on_start = {});

  /// v(0) alone, of momenta at all sites. Until the next shoot there are no other velocities, and the adjoint throws
  /// std::logic_error.
  const Field<T>& starting_velocity(const std::vector<MomentumPointers<T>>& momenta);

  /// v(t_k), k = 0..time_steps * map_steps, t_k evenly spaced over [0,1], interleaved, mm per unit time.
  const std::vector<Field<T>>& velocities() const { return velocities_; }

  /// Sum over scales, and over the normals of oriented momenta, of 1/2 (rho | K rho) of the transported momenta at
  /// every node of the last shoot, which must have been of these momenta and all blocks. With one kernel it is the
  /// Hamiltonian and conserved; with several each momentum goes its own way and it need not be. Throws InvalidInput
  /// where there are oriented momenta and evolution is `carried`.
  std::vector<double> hamiltonians(const std::vector<MomentumPointers<T>>& momenta);

  /// Adjoint of the last shoot and its blocks. `velocity_duals` (dE/dv(t_k), modified) -> adds dE/dm to `gradient`; and
  /// adds to `preconditioned` (order 0 only) the same force without the outer kernel and cell volume: the V-gradient,
  /// with gradient = a_0 V K * preconditioned up to discretisation.
  void adjoint(const std::vector<MomentumPointers<T>>& momenta, std::vector<Field<T>>& velocity_duals,
               const std::vector<MomentumTargets<T>>& gradient, const std::vector<MomentumTargets<T>>& preconditioned);

 private:
  /// What scales on one lattice have in common.
  struct SharedLattice {
    SharedLattice(const Lattice<Dim>& lattice, const Lattice<Dim>& velocity_lattice);
    void make_fields(Evolution evolution);
    Lattice<Dim> lattice;
    bool moves_everywhere = false;  ///< a scale has an order 0
    LatticeInterpolation<Dim, T> prolongation;
    MovedSites<Dim, T> sites;
    // Fields are empty where no scale has momenta at the sites.
    std::vector<Field<T>> position;   ///< displacement of the sites at node k = 0..N-1; [0] empty, meaning 0
    std::vector<Field<T>> predicted;  ///< at node k = 1..N; [0] empty
    BlockMask<Dim> moved;             ///< where sites have to be known
    BlockMask<Dim> acting;            ///< where sites can have an influence on the velocity
    Field<T> sum;                     ///< velocity of all its scales; of no use where prolongation is the identity
    bool is_sum_written = false;      ///< of this node, so that others add to it
    Field<T> position_dual;           ///< empty with a single step, whose sites begin where nothing can move them
    Field<T> predicted_dual;
    Field<T> restricted;  ///< as sum
  };
  struct ScaleState {
    MomentumScale<Dim, T>* scale;
    SharedLattice* shared;
    std::unique_ptr<CoadjointTransport<Dim, T>> transport;
    std::unique_ptr<OrientedFlow<Dim, T>> oriented;  ///< null where the scale has none
    /// Transported momenta, later their duals. Where no momenta of order 0 can appear, `zeroth` is empty.
    Field<T> zeroth, first;
    std::vector<MomentumMasks<Dim>> reached;  ///< by the transported momenta of the last shoot, at node k = 1..N
    /// Empty: the scale has order 0 and is the first of its lattice, whose sum it writes. Scratch in the adjoint.
    Field<T> velocity;
  };
  AxisBlocks<Dim> momenta_of(std::size_t scale) const;
  AxisBlocks<Dim> wanted_of(std::size_t scale) const;
  MomentumMasks<Dim> at_start(std::size_t scale, const AxisBlocks<Dim>& blocks) const;
  void begin_velocity();
  const T* add_velocity(ScaleState& state, const T* zeroth, const T* first, const MomentumMasks<Dim>& at,
                        Field<T>& velocity);
  void finish_velocity(int k, Field<T>& velocity);
  /// v at the end of a step, among the velocities of all nodes.
  std::size_t end_of_step(int k) const { return static_cast<std::size_t>(k) * map_steps_; }
  void fill_between_steps();
  void gather_between_steps(std::vector<Field<T>>& velocity_duals) const;
  void correct_adjoint(int k, std::vector<Field<T>>& velocity_duals);
  void synthesise_adjoint(int k, const T* velocity_dual, const std::vector<MomentumPointers<T>>& momenta,
                          const std::vector<MomentumTargets<T>>& gradient,
                          const std::vector<MomentumTargets<T>>& preconditioned);
  void predict_adjoint(int k, std::vector<Field<T>>& velocity_duals);
  void choose_sites();
  void start(const std::vector<MomentumPointers<T>>& momenta, const ActiveBlocks<Dim>& blocks,
             const StartingVelocity& on_start);

  Lattice<Dim> lattice_;
  int time_steps_, map_steps_;
  std::vector<std::unique_ptr<SharedLattice>> lattices_;
  std::vector<ScaleState> states_;
  std::vector<Field<T>> velocities_;
  bool is_velocity_written_ = false;  ///< of this node, so that others add to it
  ActiveBlocks<Dim> blocks_;
  std::function<void()> poll_;
};

}  // namespace saltus
