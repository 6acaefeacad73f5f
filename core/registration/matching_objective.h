#pragma once

#include "core/flow/backward_map.h"
#include "core/flow/geodesic_shooting.h"
#include "core/grid/resampling.h"
#include "core/grid/warp.h"
#include "core/momenta/block_set.h"
#include "core/momenta/directional_momentum.h"
#include "core/optimisation/objective.h"
#include "core/registration/sparsity_rounds.h"
#include "core/similarity/similarity.h"

#include <functional>
#include <memory>
#include <optional>

namespace saltus {

/// What one evaluation found; sparsity is the optimiser's part.
struct EnergyParts {
  double similarity = 0;
  double regularisation = 0;
};

/// What the gradient says of first-order momenta that are still 0, by the groups that pull harder than their weight.
struct FirstOrderPromise {
  /// Sum of (|g| - weight)^2 / (2 stiffness), as a multiple of the similarity. The similarity's own curvature is not in
  /// it, so only its order of magnitude means something.
  double gain = 0;
  /// Mean square of g along an interface over that across it (m_i: component i), by component. What slides pulls along;
  /// noise, and motion that is smooth but finer than order 0, pull in all directions alike: 1. 0 where nothing pulls.
  double shear = 0;
};

/// Everything of one pyramid level that does not change while it is optimised.
template <int Dim, class T>
struct MatchingLevel {
  Lattice<Dim> lattice;  ///< of the fixed image at this level
  std::vector<T> fixed;
  std::vector<T> fixed_weights;  ///< empty: 1 everywhere
  FramedImage<Dim, T> moving;
  FramedImage<Dim, T> moving_weights;  ///< no samples: 1 everywhere
  double similarity_weight = 1;
  double divergence_weight = 0;  ///< of 1/2 integral |div v|^2 over space and time
  int time_steps = 4, map_steps = 1;
  Evolution evolution = Evolution::Exact;
};

/// The moving image and the weights (both masks; empty without masks) on the level's lattice, after `displacement`.
template <int Dim, class T>
void warp_level(const MatchingLevel<Dim, T>& level, const Field<T>& displacement, std::vector<T>& warped,
                std::vector<T>& weights);

/// E(m) = weight * E_S(I0 o psi_1, I1) + sum over scales and orders of 1/2 ||v_i(0)||^2 + divergence penalty, with its
/// exact discrete gradient. x holds, scale by scale, the order-0 field and then the Dim order-1 fields (one field m_w
/// where the scale has directions), as far as a scale has them; of each order-1 field only what lies in its active
/// blocks, in the compact order of block_set.h. All other momenta are 0.
///
/// With sparsity, `revise` keeps the blocks to what can be other than 0: a block joins as soon as one of its groups is
/// seen with a gradient above its weight (the optimality condition of a group at 0), so that a minimum over the active
/// blocks is one over all; blocks that are 0 and want to stay so leave when they are a quarter of the active ones.
/// Without sparsity all blocks are active.
///
/// After a scale's order-1 fields lie its oriented momenta (oriented_momenta.h), those of the active elements only.
/// Elements join and leave like blocks, one by one. Those that may join are the ones that `weigh` has turned: where the
/// velocity of its x shows an interface, one a site, with that interface's normal (interface_normals.h).
template <int Dim, class T>
class MatchingObjective final : public Objective<T> {
 public:
  /// `scales` and `level` must outlive this. `sparsity` is lambda, per mm of a_1 m_i; oriented momenta have
  /// `oriented_sparsity` times as much. All blocks are active, and no element. Velocities and the map live on `flow`,
  /// and the images are warped with that map taken linearly between its samples; without `flow`, on the level's own
  /// lattice, where no map is interpolated.
  MatchingObjective(std::vector<MomentumScale<Dim, T>*> scales, const MatchingLevel<Dim, T>& level,
                    std::unique_ptr<Similarity<Dim, T>> similarity, double sparsity,
                    const std::optional<Lattice<Dim>>& flow = {}, double oriented_sparsity = 1);

  std::size_t size() const override { return size_; }
  Evaluation evaluate(const std::vector<T>& x, std::vector<T>& gradient, std::vector<T>& preconditioned) override;
  double first_step(const std::vector<T>& direction) override;
  const std::vector<GroupSparsity>& sparsity() const override { return sparsity_; }
  bool has_more() const override;
  void look_everywhere(bool everywhere) override { looks_everywhere_ = everywhere && lets_blocks_join_; }
  bool revise(MinimiserState<T>& state) override;

  /// Numbers of the active blocks of each order-1 field, in x's order.
  std::vector<std::vector<std::uint32_t>> active_blocks() const;
  /// Makes these blocks the active ones, which changes what x is. Fields beyond the list begin with none (all, without
  /// sparsity). Throws InvalidInput when they do not fit.
  void set_active_blocks(const std::vector<std::vector<std::uint32_t>>& active);
  /// The same for oriented momenta: numbers of the active elements by scale, rising. Scales beyond the list have none.
  /// Throws InvalidInput when they do not fit.
  std::vector<std::vector<std::uint32_t>> active_elements() const;
  void set_active_elements(const std::vector<std::vector<std::uint32_t>>& active);
  /// Active share of all blocks of all order-1 fields; 0 where there are none.
  double active_block_share() const;

  /// Where the velocities are sampled.
  const Lattice<Dim>& flow_lattice() const { return flow_; }
  /// What first orders promise from x, where they are 0, with the weights of the round. One evaluation. Not for scales
  /// with directions.
  FirstOrderPromise first_order_promise(const std::vector<T>& x);
  /// Parts of the last evaluation.
  const EnergyParts& parts() const { return parts_; }

  /// Shoots from x and gives the velocities of all nodes.
  const std::vector<Field<T>>& velocities(const std::vector<T>& x);
  std::vector<double> hamiltonians(const std::vector<T>& x);

  /// Sets the sparsity weights for a round that starts from x, and whether blocks may join in it; turns oriented
  /// momenta as the velocity of x asks for, which are from then on what x says with other normals.
  void weigh(const SparsityRound& round, const std::vector<T>& x);
  /// The factors made by `weigh`, for all sites of each order-1 field, then for all elements of the oriented momenta of
  /// each scale that has them (empty: 1 each).
  const std::vector<std::vector<float>>& weights() const { return factors_; }
  /// Puts back what `weights` gave in this round. Throws InvalidInput when they do not fit.
  void restore_weights(const SparsityRound& round, const std::vector<std::vector<float>>& factors);

  /// The normals that `weigh` found, by scale, and putting them back. Throws InvalidInput when they do not fit.
  std::vector<std::vector<float>> turned_normals() const;
  void restore_turned_normals(const std::vector<std::vector<float>>& normals);

  /// Leave out component i of m_i: such a momentum can only shear (no gradient, so it stays 0).
  void keep_shear_only() { shear_only_ = true; }
  /// Called many times in each evaluation with the share of it that is done; may throw to end it.
  void on_work(std::function<void(double)> callback);

  /// Momenta of each scale at all sites, with first orders along a direction spread to all axes. Valid until x or this
  /// changes, or the next call.
  std::vector<MomentumPointers<T>> pointers(const std::vector<T>& x) const;

 private:
  /// The first orders of one scale: where they lie and how they get from x to all sites of the lattice and back.
  struct FirstOrder {
    int fields = 0;         ///< Dim, or 1 along a direction; 0: the scale has none
    std::size_t range = 0;  ///< of its first field in sparsity_
    std::unique_ptr<DirectionalMomentum<Dim, T>> along;
    std::vector<T> momentum, gradient;       ///< of `fields` fields at all sites; unused while all blocks are active
    std::vector<T> spread, spread_gradient;  ///< m_i made of m_w, and where their gradients go
  };
  /// The oriented momenta of one scale.
  struct Oriented {
    OrientedMomenta<Dim, T>* momenta = nullptr;  ///< null: the scale has none
    std::size_t range = 0;                       ///< in sparsity_
    std::vector<std::uint32_t> active;
    /// Of a look: active elements and candidates, their values and gradients. Empty without one.
    std::vector<std::uint32_t> listed;
    std::vector<T> values, gradient;
  };
  void lay_out();
  void gather_factors();
  void weigh_with_oriented(const SparsityRound& round, std::size_t scale, const std::vector<T>& x);
  void turn_oriented(const std::vector<T>& x);
  void list_candidates(std::size_t scale, const std::vector<T>& x);
  std::vector<std::uint32_t> wanted_elements(const Oriented& oriented, const MinimiserState<T>& state, bool& changes);
  bool has_all_blocks(const FirstOrder& first) const;
  std::vector<AxisBlocks<Dim>> axis_blocks() const;
  const T* all_sites(std::size_t scale, const std::vector<T>& x) const;
  T* gradient_at_all_sites(std::size_t scale, std::vector<T>& gradient);
  std::vector<MomentumTargets<T>> targets(std::vector<T>& gradient, bool with_first);
  void finish_gradient(std::vector<T>& gradient, std::vector<T>& preconditioned);
  void drop_normal_components(const FirstOrder& first, std::size_t field_size, T* values) const;

  std::vector<MomentumScale<Dim, T>*> scales_;
  std::vector<std::size_t> zeroth_at_;       ///< by scale: where its order-0 field begins in x
  mutable std::vector<FirstOrder> first_;    ///< by scale; mutable: holds scratch
  std::vector<BlockSet<Dim>> blocks_;        ///< by order-1 field, as the first ranges of sparsity_
  std::vector<Oriented> oriented_;           ///< by scale; their ranges follow
  std::vector<std::vector<float>> factors_;  ///< of the weights of all there is, as sparsity_; its own are compact
  const MatchingLevel<Dim, T>& level_;
  std::unique_ptr<Similarity<Dim, T>> similarity_;
  Lattice<Dim> flow_;
  LatticeInterpolation<Dim, T> to_level_;  ///< from the flow's lattice to the images'
  GeodesicShooting<Dim, T> shooting_;
  BackwardMap<Dim, T> map_;
  std::vector<GroupSparsity> sparsity_;
  std::size_t size_ = 0;
  EnergyParts parts_;
  bool shear_only_ = false;
  bool lets_blocks_join_ = true, looks_everywhere_ = true;
  std::function<void(double)> on_work_;
  int polls_ = 0;
  std::vector<T> warped_, weights_, image_dual_, weight_dual_;
  Field<T> displacement_, displacement_dual_;  ///< on the level's lattice; the first unused when the flow lives there
  Field<T> map_dual_;                          ///< on the flow's lattice, when that is another
  std::vector<Field<T>> velocity_duals_;
};

}  // namespace saltus
