#pragma once

#include "core/flow/backward_map.h"
#include "core/flow/geodesic_shooting.h"
#include "core/grid/warp.h"
#include "core/momenta/directional_momentum.h"
#include "core/optimisation/objective.h"
#include "core/registration/sparsity_rounds.h"
#include "core/similarity/similarity.h"

#include <functional>
#include <memory>

namespace saltus {

/// What one evaluation found; sparsity is the optimiser's part.
struct EnergyParts {
  double similarity = 0;
  double regularisation = 0;
};

/// Everything of one pyramid level that does not change while it is optimised.
template <int Dim, class T>
struct MatchingLevel {
  Lattice<Dim> lattice;  ///< of the fixed image at this level, and of the velocities
  std::vector<T> fixed;
  std::vector<T> fixed_weights;  ///< empty: 1 everywhere
  FramedImage<Dim, T> moving;
  FramedImage<Dim, T> moving_weights;  ///< no samples: 1 everywhere
  double similarity_weight = 1;
  double divergence_weight = 0;  ///< of 1/2 integral |div v|^2 over space and time
  int time_steps = 4;
  Evolution evolution = Evolution::Exact;
};

/// The moving image and the weights (both masks; empty without masks) on the level's lattice, after `displacement`.
template <int Dim, class T>
void warp_level(const MatchingLevel<Dim, T>& level, const Field<T>& displacement, std::vector<T>& warped,
                std::vector<T>& weights);

/// E(m) = weight * E_S(I0 o psi_1, I1) + sum over scales and orders of 1/2 ||v_i(0)||^2 + divergence penalty, with its
/// exact discrete gradient. x holds, scale by scale, the order-0 field and then the Dim order-1 fields (one field m_w
/// where the scale has directions), as far as a scale has them.
template <int Dim, class T>
class MatchingObjective final : public Objective<T> {
 public:
  /// `scales` and `level` must outlive this. `sparsity` is lambda, per mm of a_1 m_i.
  MatchingObjective(std::vector<MomentumScale<Dim, T>*> scales, const MatchingLevel<Dim, T>& level,
                    std::unique_ptr<Similarity<Dim, T>> similarity, double sparsity);

  std::size_t size() const override { return size_; }
  Evaluation evaluate(const std::vector<T>& x, std::vector<T>& gradient, std::vector<T>& preconditioned) override;
  double first_step(const std::vector<T>& direction) override;
  const std::vector<GroupSparsity>& sparsity() const override { return sparsity_; }

  /// Parts of the last evaluation.
  const EnergyParts& parts() const { return parts_; }

  /// Shoots from x and gives the velocities of all nodes.
  const std::vector<Field<T>>& velocities(const std::vector<T>& x);
  std::vector<double> hamiltonians(const std::vector<T>& x);

  /// Sets the sparsity weights for a round that starts from x.
  void weigh(const SparsityRound& round, const std::vector<T>& x);
  /// Puts back the factors that sparsity() had after `weigh`, in its order. Throws InvalidInput when they do not fit.
  void restore_weights(const std::vector<std::vector<float>>& factors);

  /// Leave out component i of m_i: such a momentum can only shear (no gradient, so it stays 0).
  void keep_shear_only() { shear_only_ = true; }
  /// Called many times in each evaluation with the share of it that is done; may throw to end it.
  void on_work(std::function<void(double)> callback);

  /// Momenta of each scale, with first orders along a direction spread to all axes. Valid until x or this changes.
  std::vector<MomentumPointers<T>> pointers(const std::vector<T>& x) const;

 private:
  std::vector<MomentumTargets<T>> targets(std::vector<T>& x) const;
  void drop_normal_components(std::vector<T>& x) const;
  void contract(std::vector<T>& gradient) const;

  /// What a scale with directions needs: m_i made of m_w, and where gradients of m_i go before they become one of m_w.
  struct Along {
    std::unique_ptr<DirectionalMomentum<Dim, T>> momentum;
    mutable std::vector<T> first, first_gradient;
  };

  std::vector<MomentumScale<Dim, T>*> scales_;
  std::vector<Along> along_;  ///< by scale; no momentum: first orders lie in x as they are
  const MatchingLevel<Dim, T>& level_;
  std::unique_ptr<Similarity<Dim, T>> similarity_;
  GeodesicShooting<Dim, T> shooting_;
  BackwardMap<Dim, T> map_;
  std::vector<GroupSparsity> sparsity_;
  std::size_t size_ = 0;
  EnergyParts parts_;
  bool shear_only_ = false;
  std::function<void(double)> on_work_;
  int polls_ = 0;
  std::vector<T> warped_, weights_, image_dual_, weight_dual_;
  Field<T> displacement_dual_;
  std::vector<Field<T>> velocity_duals_;
};

}  // namespace saltus
