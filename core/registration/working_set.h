#pragma once

#include "core/flow/geodesic_shooting.h"
#include "core/momenta/block_set.h"
#include "core/momenta/directional_momentum.h"
#include "core/momenta/momentum_scale.h"
#include "core/optimisation/lbfgs.h"
#include "core/optimisation/objective.h"
#include "core/registration/interface_normals.h"
#include "core/registration/sparsity_rounds.h"

#include <algorithm>
#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

namespace saltus {

/// How many blocks of its order-1 fields a scale may have active: a share of those that a scale of Dim fields with the
/// image's own lattice has, one at least. Scales that are coarser have fewer and cost little.
template <int Dim>
std::size_t most_active_blocks(const Lattice<Dim>& image, double share) {
  const auto blocks = static_cast<double>(Dim * BlockSet<Dim>::none(image).blocks());
  return std::max<std::size_t>(1, static_cast<std::size_t>(share * blocks));
}

/// Which momenta there are and where they lie in x, the vector that is optimised. x holds, scale by scale, the order-0
/// field and then the Dim order-1 fields (one field m_w where the scale has directions), as far as a scale has them; of
/// each order-1 field only what lies in its active blocks, in the compact order of block_set.h. All other momenta are
/// 0.
///
/// With sparsity, `revise` keeps the blocks to what can be other than 0: a block joins as soon as one of its groups is
/// seen with a gradient above its weight (the optimality condition of a group at 0), so that a minimum over the active
/// blocks is one over all (not where elements stand alone); blocks that are 0 and want to stay so leave when they are a
/// quarter of the active ones. Without sparsity all blocks are active. With `bound_active` so many are active at most,
/// and the minimum is one over these: where more want to join, blocks that want to be 0 leave at once, and of the
/// others those join whose strongest group pulls most, as a multiple of its weight.
///
/// After a scale's order-1 fields lie its oriented momenta (oriented_momenta.h), those of the active elements only.
/// Elements join and leave like blocks, one by one, and leave as well when blocks or others of them change. Those that
/// may join are candidates of `turn`: which of them, and beside what is there only with a multiple of the weight, so
/// that a minimum leaves out elements that would add little.
template <int Dim, class T>
class WorkingSet {
 public:
  /// `scales` must outlive this. `sparsity` is lambda, per mm of a_1 m_i; oriented momenta have `oriented_sparsity`
  /// times as much. All blocks are active, and no element.
  WorkingSet(std::vector<MomentumScale<Dim, T>*> scales, double sparsity, double oriented_sparsity);

  /// Length of x.
  std::size_t size() const { return size_; }
  /// Where the groups of the first orders lie in x, and their weights.
  const std::vector<GroupSparsity>& sparsity() const { return sparsity_; }

  /// As Objective says of them.
  bool has_more() const;
  void look_everywhere(bool everywhere) { looks_everywhere_ = everywhere && lets_blocks_join_; }
  Revision revise(MinimiserState<T>& state);

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
  /// Lets blocks join only while a scale has no more than so many, where there is sparsity. No bound unless said.
  void bound_active(std::size_t blocks) { most_active_ = blocks; }
  /// The most of all blocks that wanted to join at a look and had no room; 0 where all had.
  double kept_out_share() const { return kept_out_share_; }

  /// Sets the sparsity weights for a round that starts from x, and whether blocks may join in it.
  void weigh(const SparsityRound& round, const std::vector<T>& x);
  /// The factors made by `weigh`, for all sites of each order-1 field, then for the oriented momenta of each scale that
  /// has them: for all elements, or, where all normals have the same, by site (empty: 1 each).
  const std::vector<std::vector<float>>& weights() const { return factors_; }
  /// Puts back what `weights` gave in this round. Throws InvalidInput when they do not fit.
  void restore_weights(const SparsityRound& round, const std::vector<std::vector<float>>& factors);

  bool has_oriented() const;
  /// Turns the elements to the interface where there is one; what x says of elements is from then on said of other
  /// normals. `is_for_weights`: the next `weigh` is to follow how strongly the velocity changes at them. While there
  /// are no elements yet, only where enough of it is oblique, see `want_oblique`.
  void turn(const InterfaceNormals<Dim, T>& interface, bool is_for_weights = false);
  /// Elements begin only where at least this share of the interface is oblique: along axes the m_i are better. 0 unless
  /// said.
  void want_oblique(double share) { least_oblique_share_ = share; }
  /// Where a scale's elements have been turned and none of its blocks is active, none joins: what the m_i would fit
  /// there is mostly noise. If none is active when elements are turned, they take what lies along the axes as well.
  void let_elements_stand_alone() { elements_stand_alone_ = true; }
  /// The largest oblique share of a scale at the last `turn`, see InterfaceNormals; 0 before.
  double oblique_share() const { return oblique_share_; }
  /// The normals of `turn` and the elements that have them, by scale, and putting both back. Throws InvalidInput when
  /// they do not fit.
  std::vector<std::vector<float>> turned_normals() const;
  std::vector<std::vector<std::uint32_t>> turned_elements() const;
  void restore_turned(const std::vector<std::vector<float>>& normals,
                      const std::vector<std::vector<std::uint32_t>>& elements);

  /// Leave out component i of m_i: such a momentum can only shear (no gradient, so it stays 0).
  void keep_shear_only() { shear_only_ = true; }

  /// Momenta of each scale at all sites, with first orders along a direction spread to all axes. Valid until x or this
  /// changes, or the next call.
  std::vector<MomentumPointers<T>> pointers(const std::vector<T>& x) const { return pointers(x, Reads::Everywhere); }

  /// The same for an evaluation with gradient, which reads first orders in active blocks alone: in a look, with the
  /// elements that may join beside the active ones.
  std::vector<MomentumPointers<T>> evaluated(const std::vector<T>& x);
  /// Where momenta are, and where gradients are wanted.
  ActiveBlocks<Dim> blocks() const;
  /// Where an evaluation's gradients go, by scale; those of first orders are not in x's layout before
  /// `finish_gradient`.
  std::vector<MomentumTargets<T>> targets(std::vector<T>& gradient);
  void finish_gradient(std::vector<T>& gradient);
  /// The same for what is preconditioned by the objective, order 0 alone: its fields one after the other.
  std::vector<MomentumTargets<T>> dense_targets(std::vector<T>& preconditioned) const;
  std::size_t dense_size() const;
  /// Whether any first-order momentum along an axis, where all are 0, is pulled harder than its weight: by the gradient
  /// of an evaluation that looked everywhere. Not asked for scales with directions or oriented momenta.
  bool would_join(std::vector<T>& gradient);

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
    std::vector<T> strengths;  ///< by site, see InterfaceNormals; from `turn` to `weigh`
    /// Of a look: active elements and candidates, their values and gradients. Empty without one.
    std::vector<std::uint32_t> listed;
    std::vector<T> values, gradient;
  };
  /// Where everything lay before a revision.
  struct Layout {
    std::vector<std::size_t> zeroth_at, begins;
    std::vector<BlockSet<Dim>> blocks;
    std::vector<std::vector<std::uint32_t>> elements;
    std::vector<char> was_complete;  ///< by scale: all blocks were active
  };
  struct BlockCount {
    std::size_t all = 0, active = 0, staying = 0, joining = 0;
    bool is_full = false;  ///< more want to join than there is room for
    std::size_t idle() const { return active - staying; }
    BlockCount& operator+=(const BlockCount& other) {
      all += other.all;
      active += other.active;
      staying += other.staying;
      joining += other.joining;
      is_full = is_full || other.is_full;
      return *this;
    }
  };
  void lay_out();
  void gather_factors();
  float factor_of(const Oriented& oriented, std::uint32_t element) const;
  bool has_elements(std::size_t scale) const;
  bool may_stand_alone(std::size_t scale) const;
  bool looks_at_blocks(std::size_t scale) const;
  std::vector<std::vector<float>> sizes_of(std::size_t scale, const std::vector<T>& x) const;
  std::vector<std::vector<float>> reweighted(std::size_t scale, const std::vector<T>& x) const;
  void list_candidates(std::size_t scale, const std::vector<T>& x);
  void mark_needed_blocks(MinimiserState<T>& state, std::vector<std::vector<char>>& wanted);
  BlockCount count_blocks(std::size_t scale, const std::vector<std::vector<char>>& wanted) const;
  bool wanted_blocks(MinimiserState<T>& state, std::vector<std::vector<char>>& wanted);
  double pull_at(std::size_t field, std::size_t site, const T* gradient) const;
  double pull_of_block(std::size_t field, std::size_t block, const T* gradient) const;
  std::size_t keep_out(std::size_t scale, std::size_t room, std::vector<T>& gradient,
                       std::vector<std::vector<char>>& wanted);
  template <class IsSo>
  bool any_beside(const Oriented& oriented, std::uint32_t element, IsSo&& is_so) const;
  std::vector<std::uint32_t> wanted_elements(const Oriented& oriented, const MinimiserState<T>& state, bool& changes);
  Layout layout() const;
  template <class Value>
  void reshape(const Layout& before, std::vector<Value>& values) const;
  void fetch_gradients(const Layout& before, MinimiserState<T>& state) const;
  bool has_all_blocks(const FirstOrder& first) const;
  bool has_no_blocks(const FirstOrder& first) const;
  enum class Reads { Everywhere, WithinBlocks };
  std::vector<MomentumPointers<T>> pointers(const std::vector<T>& x, Reads reads) const;
  std::vector<AxisBlocks<Dim>> axis_blocks() const;
  const T* all_sites(std::size_t scale, const std::vector<T>& x) const;
  T* gradient_at_all_sites(std::size_t scale, std::vector<T>& gradient);
  void drop_normal_components(const FirstOrder& first, std::size_t field_size, T* values) const;

  std::vector<MomentumScale<Dim, T>*> scales_;
  std::vector<std::size_t> zeroth_at_;       ///< by scale: where its order-0 field begins in x
  mutable std::vector<FirstOrder> first_;    ///< by scale; mutable: holds scratch
  std::vector<BlockSet<Dim>> blocks_;        ///< by order-1 field, as the first ranges of sparsity_
  std::vector<Oriented> oriented_;           ///< by scale; their ranges follow
  std::vector<std::vector<float>> factors_;  ///< of the weights of all there is, as sparsity_; its own are compact
  std::vector<GroupSparsity> sparsity_;
  std::size_t size_ = 0;
  double oblique_share_ = 0, least_oblique_share_ = 0;
  std::size_t most_active_ = std::numeric_limits<std::size_t>::max();  ///< of a scale
  double kept_out_share_ = 0;
  bool shear_only_ = false;
  bool lets_blocks_join_ = true, looks_everywhere_ = true;
  bool elements_stand_alone_ = false;
};

}  // namespace saltus
