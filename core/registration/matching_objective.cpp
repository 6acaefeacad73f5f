#include "core/registration/matching_objective.h"

#include "core/flow/divergence_penalty.h"
#include "core/registration/interface_normals.h"
#include "core/support/random.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>

namespace saltus {

template <int Dim, class T>
void warp_level(const MatchingLevel<Dim, T>& level, const Displacement<Dim, T>& displacement, Field<T>& warped,
                Field<T>& weights, T* slopes, OnSample sides) {
  warped.resize(level.lattice.sites());
  warp<Dim, T>(level.moving, level.lattice, displacement, warped.data(), slopes, sides);
  if (level.moving_weights.samples.empty()) {
    weights.assign(level.fixed_weights.begin(), level.fixed_weights.end());
    return;
  }
  weights.resize(level.lattice.sites());
  warp<Dim, T>(level.moving_weights, level.lattice, displacement, weights.data());
  for (std::size_t i = 0; i < level.fixed_weights.size(); ++i) weights[i] *= level.fixed_weights[i];
}

template <int Dim, class T>
MatchingObjective<Dim, T>::MatchingObjective(std::vector<MomentumScale<Dim, T>*> scales,
                                             const MatchingLevel<Dim, T>& level,
                                             std::unique_ptr<Similarity<Dim, T>> similarity, double sparsity,
                                             const std::optional<Lattice<Dim>>& flow, double oriented_sparsity)
    : scales_(scales),
      set_(std::move(scales), sparsity, oriented_sparsity),
      level_(level),
      similarity_(std::move(similarity)),
      flow_(flow.value_or(level.lattice)),
      to_level_(flow_, level.lattice, Dim),
      shooting_(scales_, flow_, level.time_steps, level.evolution, level.map_steps),
      map_(flow_, flow_, level.time_steps * level.map_steps) {
  const std::size_t sites = level.lattice.sites();
  image_dual_.resize(sites);
  map_dual_.resize(Dim * flow_.sites());
  velocity_duals_.assign(shooting_.nodes(), Field<T>(Dim * flow_.sites()));
  if (!level.moving_weights.samples.empty())
    weight_dual_.resize(sites);
  else if (!to_level_.is_identity())
    slopes_.resize(Dim * sites);
  warp_level<Dim, T>(level, {}, warped_, weights_);  // at rest
  similarity_->prepare(level.fixed.data(), warped_.data(), weights_.empty() ? nullptr : weights_.data());
}

/// A displacement on the flow's lattice as the images take it.
template <int Dim, class T>
Displacement<Dim, T> MatchingObjective<Dim, T>::on_level(const Field<T>& field) {
  return {field.data(), to_level_.is_identity() ? nullptr : &to_level_};
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
Evaluation MatchingObjective<Dim, T>::evaluate(const std::vector<T>& x, std::vector<T>& gradient,
                                               std::vector<T>& preconditioned) {
  return evaluate_with(OnSample::Upper, x, gradient, preconditioned);
}

template <int Dim, class T>
Evaluation MatchingObjective<Dim, T>::evaluate_between_sides(const std::vector<T>& x, std::vector<T>& gradient,
                                                             std::vector<T>& preconditioned) {
  return evaluate_with(OnSample::Mean, x, gradient, preconditioned);
}

template <int Dim, class T>
Evaluation MatchingObjective<Dim, T>::evaluate_with(OnSample sides, const std::vector<T>& x, std::vector<T>& gradient,
                                                    std::vector<T>& preconditioned) {
  polls_ = 0;
  if (on_work_) on_work_(0);
  const std::vector<MomentumPointers<T>> momenta = set_.evaluated(x);
  const std::vector<MomentumTargets<T>> gradients = set_.targets(gradient), scaled = set_.dense_targets(preconditioned);

  // The penalty's gradient is a V K m, so its preconditioned form is m itself. Where there is order 0 alone it is V
  // times the velocity that shooting begins with.
  parts_ = {};
  const ActiveBlocks<Dim> blocks = set_.blocks();
  for (std::size_t s = 0; s < scales_.size(); ++s) {
    const Lattice<Dim>& lattice = scales_[s]->lattice();
    if (scales_[s]->has_first_order()) {
      MomentumMasks<Dim> at = scales_[s]->everywhere(), wanted = at;
      at.first = masks_of<Dim>(lattice, blocks.momenta[s]);
      wanted.first = masks_of<Dim>(lattice, blocks.wanted[s]);
      parts_.regularisation +=
          scales_[s]->penalty(momenta[s].zeroth, momenta[s].first, at, wanted, gradients[s].zeroth, gradients[s].first);
    }
    if (const T* zeroth = momenta[s].zeroth)
      BlockMask<Dim>::all(lattice).for_runs(lattice, [&](std::size_t begin, std::size_t count) {
        std::copy_n(zeroth + Dim * begin, Dim * count, scaled[s].zeroth + Dim * begin);
      });
    if (OrientedMomenta<Dim, T>* oriented = scales_[s]->oriented()) {
      std::fill_n(gradients[s].oriented, oriented->kComponents * momenta[s].elements->size(), T(0));
      parts_.regularisation += oriented->penalty(*momenta[s].elements, momenta[s].oriented, gradients[s].oriented);
    }
  }
  shooting_.shoot(momenta, blocks, [&](std::size_t s, const T* velocity) {
    parts_.regularisation += scales_[s]->penalty_of_velocity(momenta[s].zeroth, velocity, gradients[s].zeroth);
  });
  const Displacement<Dim, T> displacement = on_level(map_.follow(shooting_.velocities()));
  warp_level<Dim, T>(level_, displacement, warped_, weights_, slopes(), sides);
  const T* weights = weights_.empty() ? nullptr : weights_.data();
  parts_.similarity =
      level_.similarity_weight * similarity_->evaluate(level_.fixed.data(), warped_.data(), weights, image_dual_.data(),
                                                       weight_dual_.empty() ? nullptr : weight_dual_.data());
  if (!std::isfinite(parts_.similarity)) return {parts_.similarity, false};

  scale_duals(image_dual_, weight_dual_);
  for (Field<T>& dual : velocity_duals_) BlockMask<Dim>::all(flow_).clear(flow_, Dim, dual.data());
  if (level_.divergence_weight > 0)
    for (int k = 0, last = shooting_.nodes() - 1; k <= last; ++k) {
      const double share = (k == 0 || k == last ? 0.5 : 1.0) / last;  // trapezoidal rule
      parts_.regularisation += add_divergence_penalty<Dim, T>(
          flow_, shooting_.velocities()[k].data(), level_.divergence_weight * share, velocity_duals_[k].data());
    }
  pull_back(image_dual_, weight_dual_, displacement, momenta, gradients, scaled, sides);
  set_.finish_gradient(gradient);
  const double energy = parts_.similarity + parts_.regularisation;
  return {energy, std::isfinite(energy)};
}

/// From the similarity's gradient in the warped image and the weights to the energy's in what is warped.
template <int Dim, class T>
void MatchingObjective<Dim, T>::scale_duals(Field<T>& image_dual, Field<T>& weight_dual) const {
  const T weight = static_cast<T>(level_.similarity_weight);
  if (weight != 1)
    for (T& dual : image_dual) dual *= weight;
  for (std::size_t i = 0; i < weight_dual.size(); ++i)
    weight_dual[i] *= weight * (level_.fixed_weights.empty() ? T(1) : level_.fixed_weights[i]);
}

/// Where the warped image's slopes are kept until its dual is known: corners of cells are then fetched once. Where
/// images and flow share a lattice, what follows has room for them. Null where the moving image has weights: those of
/// both would take three quarters of what a level's images do.
template <int Dim, class T>
T* MatchingObjective<Dim, T>::slopes() {
  if (!weight_dual_.empty()) return nullptr;
  return (slopes_.empty() ? map_dual_ : slopes_).data();
}

/// Adds to the gradients of the momenta what images, just warped, and, as they are, velocity_duals_ ask for.
template <int Dim, class T>
void MatchingObjective<Dim, T>::pull_back(const Field<T>& image_dual, const Field<T>& weight_dual,
                                          const Displacement<Dim, T>& displacement,
                                          const std::vector<MomentumPointers<T>>& momenta,
                                          const std::vector<MomentumTargets<T>>& gradients,
                                          const std::vector<MomentumTargets<T>>& scaled, OnSample sides) {
  if (const T* slopes = this->slopes())
    warp_adjoint<Dim, T>(image_dual.data(), slopes, level_.lattice, displacement.to_sites, map_dual_.data());
  else
    warp_adjoint<Dim, T>({{&level_.moving, image_dual.data()}, {&level_.moving_weights, weight_dual.data()}},
                         level_.lattice, displacement, map_dual_.data(), sides);
  map_.adjoint(shooting_.velocities(), map_dual_, velocity_duals_);
  shooting_.adjoint(momenta, velocity_duals_, gradients, scaled);
}

template <int Dim, class T>
bool MatchingObjective<Dim, T>::noise_gradient(const std::vector<T>& x, std::vector<T>& gradient,
                                               std::vector<T>& preconditioned) {
  if (!(level_.noise > 0)) return false;
  noise_pull(level_.noise, x, gradient, preconditioned);
  return true;
}

/// See noise_gradient, of that much noise.
template <int Dim, class T>
void MatchingObjective<Dim, T>::noise_pull(double noise, const std::vector<T>& x, std::vector<T>& gradient,
                                           std::vector<T>& preconditioned) {
  const T sd = static_cast<T>(noise);
  Field<T> noisy = warped_, image_dual(warped_.size()), weight_dual(weight_dual_.size());
#pragma omp parallel for schedule(static)
  for (std::size_t i = 0; i < noisy.size(); ++i)
    noisy[i] += random_bits(0, {static_cast<std::int64_t>(i)}) & 1 ? sd : -sd;
  similarity_->evaluate(level_.fixed.data(), noisy.data(), weights_.empty() ? nullptr : weights_.data(),
                        image_dual.data(), weight_dual.empty() ? nullptr : weight_dual.data());
  scale_duals(image_dual, weight_dual);
  for (std::size_t i = 0; i < image_dual.size(); ++i) image_dual[i] -= image_dual_[i];
  for (std::size_t i = 0; i < weight_dual.size(); ++i) weight_dual[i] -= weight_dual_[i];
  const std::vector<MomentumPointers<T>> momenta = set_.evaluated(x);
  std::fill(gradient.begin(), gradient.end(), T(0));
  std::fill(preconditioned.begin(), preconditioned.end(), T(0));
  const std::vector<MomentumTargets<T>> gradients = set_.targets(gradient);
  for (std::size_t s = 0; s < scales_.size(); ++s) {  // first orders may be gathered elsewhere
    if (gradients[s].first) std::fill_n(gradients[s].first, Dim * scales_[s]->field_size(), T(0));
    if (OrientedMomenta<Dim, T>* oriented = scales_[s]->oriented())
      std::fill_n(gradients[s].oriented, oriented->kComponents * momenta[s].elements->size(), T(0));
  }
  for (Field<T>& velocity_dual : velocity_duals_) BlockMask<Dim>::all(flow_).clear(flow_, Dim, velocity_dual.data());
  const Displacement<Dim, T> displacement = on_level(map_.follow(shooting_.velocities()));
  if (slopes() == map_dual_.data())  // where the gradient has taken their place
    warp_level<Dim, T>(level_, displacement, warped_, weights_, slopes());
  pull_back(image_dual, weight_dual, displacement, momenta, gradients, set_.dense_targets(preconditioned));
  set_.finish_gradient(gradient);
}

template <int Dim, class T>
PullOverNoise MatchingObjective<Dim, T>::pull_over_noise(const std::vector<T>& x, std::size_t s,
                                                         MomentumScale<Dim, T>& other, double noise) {
  std::vector<T> gradient(size()), pull(set_.dense_size());
  const auto square = [&](MomentumScale<Dim, T>& scale) {
    const T* momenta = set_.dense_targets(pull)[s].zeroth;
    Field<T> velocity(scale.field_size());
    scale.synthesise(momenta, nullptr, velocity.data());
    return std::inner_product(velocity.begin(), velocity.end(), momenta, 0.0, std::plus<>(),
                              [](T a, T b) { return static_cast<double>(a) * b; });
  };
  evaluate(x, gradient, pull);
  for (std::size_t i = 0; i < x.size(); ++i) pull[i] -= x[i];  // the penalty's part, see evaluate
  const double own = square(*scales_[s]), of_other = square(other);
  noise_pull(noise, x, gradient, pull);
  const auto over = [&](double found, double of_noise) { return found > 0 && of_noise > 0 ? found / of_noise : 0; };
  return {over(own, square(*scales_[s])), over(of_other, square(other))};
}

template <int Dim, class T>
bool MatchingObjective<Dim, T>::would_join(const std::vector<T>& x) {
  set_.look_everywhere(true);
  std::vector<T> gradient(size()), preconditioned(set_.dense_size());
  evaluate(x, gradient, preconditioned);
  return set_.would_join(gradient);
}

template <int Dim, class T>
void MatchingObjective<Dim, T>::weigh(const SparsityRound& round, const std::vector<T>& x) {
  if (set_.has_oriented())
    set_.turn(InterfaceNormals<Dim, T>(flow_, starting_velocity(x)), round.weights == SparsityRound::Weights::OfShear);
  set_.weigh(round, x);
}

template <int Dim, class T>
void MatchingObjective<Dim, T>::smooth_zeroth(std::vector<T>& x) {
  const std::vector<MomentumPointers<T>> momenta = set_.pointers(x);
  for (std::size_t s = 0; s < scales_.size(); ++s) {
    const T* zeroth = momenta[s].zeroth;
    if (!zeroth) continue;
    const Field<T> ones(scales_[s]->field_size(), T(1));
    Field<T> velocity(ones.size()), mass(ones.size());
    scales_[s]->synthesise(zeroth, nullptr, velocity.data());
    scales_[s]->synthesise(ones.data(), nullptr, mass.data());
    std::transform(velocity.begin(), velocity.end(), mass.begin(), x.begin() + (zeroth - x.data()), std::divides<T>());
  }
}

template <int Dim, class T>
double MatchingObjective<Dim, T>::first_step(const std::vector<T>& direction) {
  // Half a voxel of motion somewhere: large enough to learn the curvature from, small enough to stay where it holds.
  const std::vector<MomentumPointers<T>> momenta = set_.pointers(direction);
  double largest = 0;
  for (std::size_t s = 0; s < scales_.size(); ++s) {
    Field<T> velocity(scales_[s]->field_size());
    if (scales_[s]->has_fields()) scales_[s]->synthesise(momenta[s].zeroth, momenta[s].first, velocity.data());
    if (OrientedMomenta<Dim, T>* oriented = scales_[s]->oriented()) {
      std::vector<T> corners;
      oriented->place(*momenta[s].elements, corners);
      oriented->add_velocity(*momenta[s].elements, corners.data(), momenta[s].oriented, velocity.data());
    }
    for (T v : velocity) largest = std::max(largest, std::abs(static_cast<double>(v)));
  }
  const double voxel = *std::min_element(level_.lattice.spacing.begin(), level_.lattice.spacing.end());
  return largest > 0 ? 0.5 * voxel / largest : 1.0;
}

template <int Dim, class T>
const Field<T>& MatchingObjective<Dim, T>::starting_velocity(const std::vector<T>& x) {
  return shooting_.starting_velocity(set_.pointers(x));
}

template <int Dim, class T>
const std::vector<Field<T>>& MatchingObjective<Dim, T>::velocities(const std::vector<T>& x) {
  shooting_.shoot(set_.pointers(x));
  return shooting_.velocities();
}

template <int Dim, class T>
const Field<T>& MatchingObjective<Dim, T>::displacement(const std::vector<T>& x) {
  return map_.follow(velocities(x));
}

template <int Dim, class T>
std::vector<double> MatchingObjective<Dim, T>::hamiltonians(const std::vector<T>& x) {
  return shooting_.hamiltonians(set_.pointers(x));
}

template void warp_level(const MatchingLevel<2, float>&, const Displacement<2, float>&, Field<float>&, Field<float>&,
                         float*, OnSample);
template void warp_level(const MatchingLevel<3, float>&, const Displacement<3, float>&, Field<float>&, Field<float>&,
                         float*, OnSample);
template void warp_level(const MatchingLevel<2, double>&, const Displacement<2, double>&, Field<double>&,
                         Field<double>&, double*, OnSample);
template void warp_level(const MatchingLevel<3, double>&, const Displacement<3, double>&, Field<double>&,
                         Field<double>&, double*, OnSample);
template class MatchingObjective<2, float>;
template class MatchingObjective<3, float>;
template class MatchingObjective<2, double>;
template class MatchingObjective<3, double>;

}  // namespace saltus
