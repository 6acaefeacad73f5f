#include "core/registration/matching_objective.h"

#include "core/flow/divergence_penalty.h"
#include "core/momenta/reweighting.h"
#include "core/support/errors.h"

#include <algorithm>
#include <cmath>

namespace saltus {

template <int Dim, class T>
void warp_level(const MatchingLevel<Dim, T>& level, const Field<T>& displacement, std::vector<T>& warped,
                std::vector<T>& weights) {
  warped.resize(level.lattice.sites());
  warp<Dim, T>(level.moving, level.lattice, displacement.data(), warped.data());
  if (level.moving_weights.samples.empty()) {
    weights = level.fixed_weights;
    return;
  }
  weights.resize(level.lattice.sites());
  warp<Dim, T>(level.moving_weights, level.lattice, displacement.data(), weights.data());
  for (std::size_t i = 0; i < level.fixed_weights.size(); ++i) weights[i] *= level.fixed_weights[i];
}

template <int Dim, class T>
MatchingObjective<Dim, T>::MatchingObjective(std::vector<MomentumScale<Dim, T>*> scales,
                                             const MatchingLevel<Dim, T>& level,
                                             std::unique_ptr<Similarity<Dim, T>> similarity, double sparsity)
    : scales_(scales),
      level_(level),
      similarity_(std::move(similarity)),
      shooting_(scales, level.lattice, level.time_steps, level.evolution),
      map_(level.lattice, level.lattice, level.time_steps) {
  for (const MomentumScale<Dim, T>* scale : scales_) {
    if (has_zeroth(scale->options().orders)) size_ += scale->field_size();
    if (!scale->has_first_order()) {
      along_.emplace_back();
      continue;
    }
    const double weight = sparsity * scale->options().first_weight * scale->lattice().cell_volume();
    if (!scale->options().direction.empty()) {
      // The stiffness of m_w is sum_i w_i^2 times those of the axes; one number must do, and their mean is near.
      double stiffness = 0;
      for (int axis = 0; axis < Dim; ++axis) stiffness += scale->first_order_stiffness(axis) / Dim;
      sparsity_.push_back({size_, size_ + scale->field_size(), Dim, weight, 1 / stiffness, {}});
      size_ += scale->field_size();
      along_.push_back({std::make_unique<DirectionalMomentum<Dim, T>>(scale->options().direction),
                        std::vector<T>(Dim * scale->field_size()), std::vector<T>(Dim * scale->field_size())});
      continue;
    }
    for (int axis = 0; axis < Dim; ++axis) {
      sparsity_.push_back(
          {size_, size_ + scale->field_size(), Dim, weight, 1 / scale->first_order_stiffness(axis), {}});
      size_ += scale->field_size();
    }
    along_.emplace_back();
  }
  const std::size_t sites = level.lattice.sites();
  image_dual_.resize(sites);
  displacement_dual_.resize(Dim * sites);
  velocity_duals_.assign(level.time_steps + 1, Field<T>(Dim * sites));
  if (!level.moving_weights.samples.empty()) weight_dual_.resize(sites);
  warp_level<Dim, T>(level, displacement_dual_, warped_, weights_);  // the dual is still 0: at rest
  similarity_->prepare(level.fixed.data(), warped_.data(), weights_.empty() ? nullptr : weights_.data());
}

template <int Dim, class T>
void MatchingObjective<Dim, T>::on_work(std::function<void(double)> callback) {
  on_work_ = std::move(callback);
  if (!on_work_) {
    shooting_.on_work({});
    return;
  }
  // Shooting and its adjoint ask once a node and scale, once more in the adjoint for node 0.
  const double expected = static_cast<double>(scales_.size()) * (2 * level_.time_steps + 1) + 1;
  shooting_.on_work([this, expected] { on_work_(std::min(1.0, ++polls_ / expected)); });
}

template <int Dim, class T>
std::vector<MomentumPointers<T>> MatchingObjective<Dim, T>::pointers(const std::vector<T>& x) const {
  std::vector<MomentumPointers<T>> all;
  std::size_t at = 0;
  for (std::size_t s = 0; s < scales_.size(); ++s) {
    const MomentumScale<Dim, T>* scale = scales_[s];
    MomentumPointers<T> momenta;
    if (has_zeroth(scale->options().orders)) {
      momenta.zeroth = x.data() + at;
      at += scale->field_size();
    }
    if (along_[s].momentum) {
      along_[s].momentum->expand(x.data() + at, along_[s].first.data());
      momenta.first = along_[s].first.data();
      at += scale->field_size();
    } else if (scale->has_first_order()) {
      momenta.first = x.data() + at;
      at += Dim * scale->field_size();
    }
    all.push_back(momenta);
  }
  return all;
}

template <int Dim, class T>
std::vector<MomentumTargets<T>> MatchingObjective<Dim, T>::targets(std::vector<T>& x) const {
  std::vector<MomentumTargets<T>> all;
  std::size_t at = 0;
  for (std::size_t s = 0; s < scales_.size(); ++s) {
    const MomentumScale<Dim, T>* scale = scales_[s];
    MomentumTargets<T> momenta;
    if (has_zeroth(scale->options().orders)) {
      momenta.zeroth = x.data() + at;
      at += scale->field_size();
    }
    if (along_[s].momentum) {
      momenta.first = along_[s].first_gradient.data();  // contract() brings it to x
      at += scale->field_size();
    } else if (scale->has_first_order()) {
      momenta.first = x.data() + at;
      at += Dim * scale->field_size();
    }
    all.push_back(momenta);
  }
  return all;
}

/// Gradients of the m_i of scales with directions -> those of m_w, in x's layout.
template <int Dim, class T>
void MatchingObjective<Dim, T>::contract(std::vector<T>& gradient) const {
  std::size_t range = 0;
  for (std::size_t s = 0; s < scales_.size(); ++s) {
    if (!scales_[s]->has_first_order()) continue;
    if (along_[s].momentum)
      along_[s].momentum->contract(along_[s].first_gradient.data(), gradient.data() + sparsity_[range].begin);
    range += along_[s].momentum ? 1 : Dim;
  }
}

template <int Dim, class T>
void MatchingObjective<Dim, T>::drop_normal_components(std::vector<T>& x) const {
  std::size_t range = 0;
  for (std::size_t s = 0; s < scales_.size(); ++s) {
    if (!scales_[s]->has_first_order()) continue;
    if (along_[s].momentum) {
      along_[s].momentum->drop_normal(x.data() + sparsity_[range++].begin);
      continue;
    }
    for (std::size_t axis = 0; axis < Dim; ++axis, ++range)
      for (std::size_t i = sparsity_[range].begin; i < sparsity_[range].end; i += Dim) x[i + axis] = 0;
  }
}

template <int Dim, class T>
void MatchingObjective<Dim, T>::weigh(const SparsityRound& round, const std::vector<T>& x) {
  std::size_t range = 0;
  for (std::size_t s = 0; s < scales_.size(); ++s) {
    if (!scales_[s]->has_first_order()) continue;
    const Lattice<Dim>& lattice = scales_[s]->lattice();
    const int fields = along_[s].momentum ? 1 : Dim;
    const T* first = x.data() + sparsity_[range].begin;
    std::vector<std::vector<float>> factors;
    switch (round.weights) {
      case SparsityRound::Weights::Even:
        factors.assign(fields, std::vector<float>(round.factor == 1 ? 0 : lattice.sites(), round.factor));
        break;
      case SparsityRound::Weights::Reweighted:
        factors = reweighted_factors<Dim, T>(lattice, first, fields);
        break;
      case SparsityRound::Weights::Debiased:
        factors = support_factors<Dim, T>(lattice, first, fields);
        break;
    }
    for (int axis = 0; axis < fields; ++axis) sparsity_[range++].factors = std::move(factors[axis]);
  }
}

template <int Dim, class T>
void MatchingObjective<Dim, T>::restore_weights(const std::vector<std::vector<float>>& factors) {
  bool fits = factors.size() == sparsity_.size();
  for (std::size_t r = 0; fits && r < factors.size(); ++r)
    fits = factors[r].empty() || factors[r].size() * Dim == sparsity_[r].end - sparsity_[r].begin;
  if (!fits)
    throw InvalidInput("the sparsity factors are " + std::to_string(factors.size()) + " lists for " +
                       std::to_string(sparsity_.size()) + " fields of first-order momenta, or of other lengths");
  for (std::size_t r = 0; r < factors.size(); ++r) sparsity_[r].factors = factors[r];
}

template <int Dim, class T>
Evaluation MatchingObjective<Dim, T>::evaluate(const std::vector<T>& x, std::vector<T>& gradient,
                                               std::vector<T>& preconditioned) {
  polls_ = 0;
  if (on_work_) on_work_(0);
  const std::vector<MomentumPointers<T>> momenta = pointers(x);
  std::fill(gradient.begin(), gradient.end(), T(0));
  std::fill(preconditioned.begin(), preconditioned.end(), T(0));
  const std::vector<MomentumTargets<T>> gradients = targets(gradient), scaled = targets(preconditioned);

  // The penalty's gradient is a V K m, so its preconditioned form is m itself.
  parts_ = {};
  for (std::size_t s = 0; s < scales_.size(); ++s) {
    parts_.regularisation +=
        scales_[s]->penalty(momenta[s].zeroth, momenta[s].first, gradients[s].zeroth, gradients[s].first);
    if (momenta[s].zeroth) std::copy_n(momenta[s].zeroth, scales_[s]->field_size(), scaled[s].zeroth);
  }

  shooting_.shoot(momenta);
  const Field<T>& displacement = map_.follow(shooting_.velocities());
  const bool moving_weights = !level_.moving_weights.samples.empty();
  warp_level<Dim, T>(level_, displacement, warped_, weights_);
  const T* weights = weights_.empty() ? nullptr : weights_.data();
  parts_.similarity =
      level_.similarity_weight * similarity_->evaluate(level_.fixed.data(), warped_.data(), weights, image_dual_.data(),
                                                       moving_weights ? weight_dual_.data() : nullptr);
  if (!std::isfinite(parts_.similarity)) return {parts_.similarity, false};

  const T weight = static_cast<T>(level_.similarity_weight);
  for (T& dual : image_dual_) dual *= weight;
  std::fill(displacement_dual_.begin(), displacement_dual_.end(), T(0));
  warp_adjoint<Dim, T>(level_.moving, level_.lattice, displacement.data(), image_dual_.data(),
                       displacement_dual_.data());
  if (moving_weights) {
    for (std::size_t i = 0; i < weight_dual_.size(); ++i)
      weight_dual_[i] *= weight * (level_.fixed_weights.empty() ? T(1) : level_.fixed_weights[i]);
    warp_adjoint<Dim, T>(level_.moving_weights, level_.lattice, displacement.data(), weight_dual_.data(),
                         displacement_dual_.data());
  }
  for (Field<T>& dual : velocity_duals_) std::fill(dual.begin(), dual.end(), T(0));
  if (level_.divergence_weight > 0)
    for (int k = 0; k <= level_.time_steps; ++k) {
      const double share = (k == 0 || k == level_.time_steps ? 0.5 : 1.0) / level_.time_steps;  // trapezoidal rule
      parts_.regularisation +=
          add_divergence_penalty<Dim, T>(level_.lattice, shooting_.velocities()[k].data(),
                                         level_.divergence_weight * share, velocity_duals_[k].data());
    }
  map_.adjoint(shooting_.velocities(), displacement_dual_, velocity_duals_);
  shooting_.adjoint(momenta, velocity_duals_, gradients, scaled);
  contract(gradient);

  for (const GroupSparsity& range : sparsity_)
    for (std::size_t i = range.begin; i < range.end; ++i)
      preconditioned[i] = static_cast<T>(range.inverse_stiffness) * gradient[i];
  if (shear_only_) {
    drop_normal_components(gradient);
    drop_normal_components(preconditioned);
  }
  const double energy = parts_.similarity + parts_.regularisation;
  return {energy, std::isfinite(energy)};
}

template <int Dim, class T>
double MatchingObjective<Dim, T>::first_step(const std::vector<T>& direction) {
  // Half a voxel of motion somewhere: large enough to learn the curvature from, small enough to stay where it holds.
  const std::vector<MomentumPointers<T>> momenta = pointers(direction);
  double largest = 0;
  for (std::size_t s = 0; s < scales_.size(); ++s) {
    Field<T> velocity(scales_[s]->field_size());
    scales_[s]->synthesise(momenta[s].zeroth, momenta[s].first, velocity.data());
    for (T v : velocity) largest = std::max(largest, std::abs(static_cast<double>(v)));
  }
  const double voxel = *std::min_element(level_.lattice.spacing.begin(), level_.lattice.spacing.end());
  return largest > 0 ? 0.5 * voxel / largest : 1.0;
}

template <int Dim, class T>
const std::vector<Field<T>>& MatchingObjective<Dim, T>::velocities(const std::vector<T>& x) {
  shooting_.shoot(pointers(x));
  return shooting_.velocities();
}

template <int Dim, class T>
std::vector<double> MatchingObjective<Dim, T>::hamiltonians(const std::vector<T>& x) {
  return shooting_.hamiltonians(pointers(x));
}

template void warp_level(const MatchingLevel<2, float>&, const Field<float>&, std::vector<float>&, std::vector<float>&);
template void warp_level(const MatchingLevel<3, float>&, const Field<float>&, std::vector<float>&, std::vector<float>&);
template class MatchingObjective<2, float>;
template class MatchingObjective<3, float>;
template class MatchingObjective<2, double>;
template class MatchingObjective<3, double>;

}  // namespace saltus
