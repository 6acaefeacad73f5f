#pragma once

#include "core/flow/backward_map.h"
#include "core/flow/geodesic_shooting.h"
#include "core/grid/resampling.h"
#include "core/grid/warp.h"
#include "core/optimisation/objective.h"
#include "core/registration/working_set.h"
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

/// See MatchingObjective::pull_over_noise; 0 where nothing pulls, or no noise would.
struct PullOverNoise {
  double own = 0, other = 0;
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
  double noise = 0;  ///< white, of both images together as if it were the moving one's, sd in the images' unit
  int time_steps = 4, map_steps = 1;
  Evolution evolution = Evolution::Exact;
};

/// The moving image and the weights (both masks; empty without masks) on the level's lattice, after `displacement`, and
/// the image's `slopes` where they are not null (see warp).
template <int Dim, class T>
void warp_level(const MatchingLevel<Dim, T>& level, const Displacement<Dim, T>& displacement, Field<T>& warped,
                Field<T>& weights, T* slopes = nullptr, OnSample sides = OnSample::Upper);

/// E(m) = weight * E_S(I0 o psi_1, I1) + sum over scales and orders of 1/2 ||v_i(0)||^2 + divergence penalty, with its
/// exact discrete gradient. What of m there is, and where it lies in x, is said by working_set.h.
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

  std::size_t size() const override { return set_.size(); }
  Evaluation evaluate(const std::vector<T>& x, std::vector<T>& gradient, std::vector<T>& preconditioned) override;
  /// At rest all points of images on one grid lie on samples, where they have kinks.
  Evaluation evaluate_between_sides(const std::vector<T>& x, std::vector<T>& gradient,
                                    std::vector<T>& preconditioned) override;
  /// Of the level's noise: each sample of the warped image has sd more or less, where it counts by the same weights.
  /// The same one at every call.
  bool noise_gradient(const std::vector<T>& x, std::vector<T>& gradient, std::vector<T>& preconditioned) override;
  /// What pulls at x at the momenta of order 0 of scale s of those that this was made of, over what noise of standard
  /// deviation `noise` (in the images' unit, above 0) makes of it, both squared: in the norm of that scale, and in that
  /// of another's order 0 on the same lattice. Two evaluations. Only where no first-order momenta are active.
  PullOverNoise pull_over_noise(const std::vector<T>& x, std::size_t s, MomentumScale<Dim, T>& other, double noise);
  double first_step(const std::vector<T>& direction) override;
  const std::vector<GroupSparsity>& sparsity() const override { return set_.sparsity(); }
  bool has_more() const override { return set_.has_more(); }
  void look_everywhere(bool everywhere) override { set_.look_everywhere(everywhere); }
  Revision revise(MinimiserState<T>& state) override { return set_.revise(state); }

  /// What there is of the momenta, and their weights.
  WorkingSet<Dim, T>& working_set() { return set_; }
  const WorkingSet<Dim, T>& working_set() const { return set_; }

  /// Where the velocities are sampled.
  const Lattice<Dim>& flow_lattice() const { return flow_; }
  /// Whether any first-order momentum would join from x, where they are 0, with the weights of the round. One
  /// evaluation. Not for scales with directions.
  bool would_join(const std::vector<T>& x);
  /// Parts of the last evaluation.
  const EnergyParts& parts() const { return parts_; }

  /// Velocity at time 0, on flow_lattice(). What is asked of the last evaluation (noise_gradient) is to be asked
  /// before.
  const Field<T>& starting_velocity(const std::vector<T>& x);
  /// Shoots from x and gives the velocities of all nodes.
  const std::vector<Field<T>>& velocities(const std::vector<T>& x);
  /// The displacement that x makes, phi_1^-1(y) - y in mm on flow_lattice(), interleaved; valid until the next
  /// evaluation. What is asked of the last one (noise_gradient) is to be asked before.
  const Field<T>& displacement(const std::vector<T>& x);
  std::vector<double> hamiltonians(const std::vector<T>& x);

  /// Sets the sparsity weights for a round that starts from x, and whether blocks may join in it; turns oriented
  /// momenta to the interface that the velocity of x shows, if it shows one (interface_normals.h), which are from then
  /// on what x says with other normals.
  void weigh(const SparsityRound& round, const std::vector<T>& x);

  /// The momentum of order 0 of each scale becomes its mean under the scale's kernel, K * m_0 / K * 1: it keeps what
  /// is wider than the kernel, at the border of the lattice as well, and loses what is narrower.
  void smooth_zeroth(std::vector<T>& x);

  /// Called many times in each evaluation with the share of it that is done; may throw to end it.
  void on_work(std::function<void(double)> callback);

 private:
  Evaluation evaluate_with(OnSample sides, const std::vector<T>& x, std::vector<T>& gradient,
                           std::vector<T>& preconditioned);
  Displacement<Dim, T> on_level(const Field<T>& field);
  void noise_pull(double noise, const std::vector<T>& x, std::vector<T>& gradient, std::vector<T>& preconditioned);
  void scale_duals(Field<T>& image_dual, Field<T>& weight_dual) const;
  T* slopes();
  void pull_back(const Field<T>& image_dual, const Field<T>& weight_dual, const Displacement<Dim, T>& displacement,
                 const std::vector<MomentumPointers<T>>& momenta, const std::vector<MomentumTargets<T>>& gradients,
                 const std::vector<MomentumTargets<T>>& scaled, OnSample sides = OnSample::Upper);

  std::vector<MomentumScale<Dim, T>*> scales_;
  WorkingSet<Dim, T> set_;
  const MatchingLevel<Dim, T>& level_;
  std::unique_ptr<Similarity<Dim, T>> similarity_;
  Lattice<Dim> flow_;
  LatticeInterpolation<Dim, T> to_level_;  ///< from the flow's lattice to the images'
  GeodesicShooting<Dim, T> shooting_;
  BackwardMap<Dim, T> map_;
  EnergyParts parts_;
  std::function<void(double)> on_work_;
  int polls_ = 0;
  Field<T> warped_, weights_;
  Field<T> image_dual_, weight_dual_;  ///< of the moving image and of its weights (empty: it has none), warped
  Field<T> map_dual_;                  ///< on the flow's lattice
  Field<T> slopes_;                    ///< see slopes(); empty where another field has room for them
  std::vector<Field<T>> velocity_duals_;
};

}  // namespace saltus
