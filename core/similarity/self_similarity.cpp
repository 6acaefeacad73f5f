#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "core/grid/noise.h"
#include "core/similarity/box_sum.h"
#include "core/similarity/similarity.h"
#include "core/support/free_memory.h"
#include "core/support/reduction.h"

namespace saltus {
namespace {

/// The context of a sample x: pairs of its neighbours. The pair (x + p, x + q) is the difference along v = q - p taken
/// at y = x + p, so few directions v, each taken at two places p, give all pairs.
template <int Dim>
struct Direction {
  Index<Dim> v{};
  Index<Dim> place[2] = {};
  Index<Dim> end[2] = {};  ///< place + v
};

/// Neighbours lie `step` samples away on each axis that has room for them; the pairs are those of different axes (four
/// for each two axes). With a single such axis, the sample itself and each of its two neighbours.
template <int Dim>
std::vector<Direction<Dim>> directions(const Lattice<Dim>& lattice, const Index<Dim>& step) {
  std::vector<int> axes;
  for (int axis = 0; axis < Dim; ++axis)
    if (lattice.size[axis] > step[axis]) axes.push_back(axis);
  std::vector<Direction<Dim>> all;
  for (std::size_t a = 0; a < axes.size(); ++a)
    for (std::size_t b = a + 1; b < axes.size(); ++b) {
      const int p = axes[a], q = axes[b];
      Direction<Dim> fall, rise;  // v = e_p - e_q and e_p + e_q
      fall.v[p] = rise.v[p] = step[p];
      fall.v[q] = -step[q];
      rise.v[q] = step[q];
      fall.place[0][q] = step[q];   // (+q, +p)
      fall.place[1][p] = -step[p];  // (-p, -q)
      rise.place[0][q] = -step[q];  // (-q, +p)
      rise.place[1][p] = -step[p];  // (-p, +q)
      all.push_back(fall);
      all.push_back(rise);
    }
  if (axes.size() == 1) {
    Direction<Dim> along;
    along.v[axes[0]] = step[axes[0]];  // (0, +p) and (-p, 0)
    along.place[1][axes[0]] = -step[axes[0]];
    all.push_back(along);
  }
  for (Direction<Dim>& direction : all)
    for (int side = 0; side < 2; ++side)
      for (int axis = 0; axis < Dim; ++axis)
        direction.end[side][axis] = direction.place[side][axis] + direction.v[axis];
  return all;
}

/// Patch distances B_v(y) = (1 / n) sum over the box at y of e_v (I(z) - I(z + v))^2 with e_v = weight(z) weight(z + v)
/// and n the samples of a whole box; D_k(x) = B_v(x + p), but 0 unless x + p and x + q are on the lattice;
///     S_k = exp(-D_k / (mean(D) + floor)),   E = V sum of weight mean_k (S_k of warped - S_k of fixed)^2.
/// The adjoint goes back through S, D, the box (its own transpose) and the differences.
template <int Dim, class T>
class SelfSimilarity final : public Similarity<Dim, T> {
 public:
  SelfSimilarity(const Lattice<Dim>& lattice, double radius_mm, double step_mm)
      : lattice_(lattice),
        sites_(lattice.sites()),
        directions_(directions<Dim>(lattice, in_samples(lattice, step_mm, 1))),
        fields_(static_cast<int>(directions_.size())),
        radius_(in_samples(lattice, radius_mm, 0)),
        box_(lattice, radius_) {
    inverse_patch_ = 1;
    for (int axis = 0; axis < Dim; ++axis)
      if (lattice.size[axis] > 1) inverse_patch_ /= 2 * radius_[axis] + 1;
    margin_ = in_samples(lattice, step_mm, 1);
    for (int axis = 0; axis < Dim; ++axis)
      if (lattice.size[axis] <= margin_[axis]) margin_[axis] = 0;  // no direction goes along this axis
    for (const Direction<Dim>& direction : directions_) {
      along_.push_back(offset(direction.v));
      for (const Index<Dim>& place : direction.place) places_.push_back(offset(place));
    }
  }

  void prepare(const T* fixed, const T* resting, const T* weights) override {
    is_prepared_ = true;
    if (fields_ == 0) return;
    double f = floor_of(fixed, weights), w = floor_of(resting, weights);
    // An image that is flat everywhere takes the other's measure; for two flat images every measure will do.
    if (f == 0) f = w > 0 ? w : 1;
    if (w == 0) w = f;
    fixed_floor_ = f;
    warped_floor_ = w;
    context_.clear();
  }

  double evaluate(const T* fixed, const T* warped, const T* weights, T* gradient, T* weight_gradient) override {
    if (!is_prepared_) throw std::logic_error("self-similarity is evaluated before prepare");
    std::fill_n(gradient, sites_, T(0));
    if (weight_gradient) std::fill_n(weight_gradient, sites_, T(0));
    if (fields_ == 0) return 0;  // a single sample is like nothing
    // Masks change what the fixed image shows; without them its context is computed once.
    if (weights || weight_gradient || context_.empty()) {
      patch_distances(fixed, weights, fixed_distances_);
      describe(fixed_distances_, fixed_floor_, context_);
    }
    patch_distances(warped, weights, warped_distances_);
    const double energy = compare(weights, weight_gradient);
    back_to_image(warped, weights, warped_distances_, warped_duals_, gradient, weight_gradient);
    if (weight_gradient) back_to_image(fixed, weights, fixed_distances_, fixed_duals_, nullptr, weight_gradient);
    if (!weights) free_vector(fixed_distances_);
    return energy;
  }

 private:
  static constexpr int kMostPairs = 2 * Dim * (Dim - 1);
  static constexpr double kFloor = 1e-3;  ///< against the mean distance

  static Index<Dim> in_samples(const Lattice<Dim>& lattice, double mm, int least) {
    Index<Dim> samples;
    for (int axis = 0; axis < Dim; ++axis)
      samples[axis] =
          std::max(least, lattice.size[axis] > 1 ? static_cast<int>(std::lround(mm / lattice.spacing[axis])) : 0);
    return samples;
  }

  int pairs() const { return 2 * fields_; }

  /// Calls visit(index, site) for all sites, slabs in parallel, and sums what it returns in the order of the slabs.
  template <class Visit>
  double ordered_slabs(Visit&& visit) const {
    std::vector<double> sums(lattice_.size[Dim - 1]);
#pragma omp parallel for schedule(static)
    for (int slab = 0; slab < lattice_.size[Dim - 1]; ++slab) {
      double sum = 0;
      visit_slab<Dim>(lattice_, slab, [&](const Index<Dim>& index, std::size_t site) { sum += visit(index, site); });
      sums[slab] = sum;
    }
    double sum = 0;
    for (double part : sums) sum += part;
    return sum;
  }

  /// Far enough from the border for every pair and every difference to be on the lattice.
  bool is_inside(const Index<Dim>& index) const {
    for (int axis = 0; axis < Dim; ++axis)
      if (index[axis] < margin_[axis] || index[axis] >= lattice_.size[axis] - margin_[axis]) return false;
    return true;
  }

  /// Whether index + sign * by is on the lattice.
  bool reaches(const Index<Dim>& index, const Index<Dim>& by, int sign) const {
    for (int axis = 0; axis < Dim; ++axis) {
      const int at = index[axis] + sign * by[axis];
      if (at < 0 || at >= lattice_.size[axis]) return false;
    }
    return true;
  }

  std::ptrdiff_t offset(const Index<Dim>& by) const {
    std::ptrdiff_t sum = 0;
    std::ptrdiff_t stride = 1;
    for (int axis = 0; axis < Dim; ++axis) {
      sum += by[axis] * stride;
      stride *= lattice_.size[axis];
    }
    return sum;
  }

  /// B_v at every site, fields together.
  void patch_distances(const T* image, const T* weights, std::vector<T>& distances) {
    distances.resize(sites_ * fields_);
    const T scale = static_cast<T>(inverse_patch_);
    ordered_slabs([&](const Index<Dim>& index, std::size_t site) {
      const bool inside = is_inside(index);
      for (int j = 0; j < fields_; ++j) {
        T& distance = distances[site * fields_ + j];
        distance = 0;
        if (!inside && !reaches(index, directions_[j].v, 1)) continue;
        const std::size_t other = site + static_cast<std::size_t>(along_[j]);
        const T shown = weights ? weights[site] * weights[other] : T(1);
        if (shown == 0) continue;  // not a product with 0: what is hidden may be NaN
        const T difference = image[site] - image[other];
        distance = scale * shown * difference * difference;
      }
      return 0.0;
    });
    box_.apply(fields_, distances.data());
  }

  /// The distances of the pairs of one sample; gives their mean.
  T gather(const std::vector<T>& distances, const Index<Dim>& index, std::size_t site, T* d) const {
    // Rounding in running sums may leave less than 0 where there is nothing.
    const bool inside = is_inside(index);
    T sum = 0;
    for (int k = 0; k < pairs(); ++k) {
      const Direction<Dim>& direction = directions_[k / 2];
      const bool is_whole =
          inside || (reaches(index, direction.place[k % 2], 1) && reaches(index, direction.end[k % 2], 1));
      const T distance = is_whole ? distances[(site + static_cast<std::size_t>(places_[k])) * fields_ + k / 2] : T(0);
      d[k] = distance < 0 ? T(0) : distance;  // what is no number stays that
      sum += d[k];
    }
    return sum / static_cast<T>(pairs());
  }

  void describe(const std::vector<T>& distances, double floor, std::vector<T>& context) {
    context.resize(sites_ * pairs());
    ordered_slabs([&](const Index<Dim>& index, std::size_t site) {
      T* s = context.data() + site * pairs();
      const T inverse = 1 / (gather(distances, index, site, s) + static_cast<T>(floor));
      for (int k = 0; k < pairs(); ++k) s[k] = std::exp(-s[k] * inverse);
      return 0.0;
    });
  }

  /// dE/dS to dE/dD of one sample, in place: dS_k/dD_l = S_k ( D_k / (V^2 K) - [k = l] / V ), V = mean(D) + floor.
  void back_to_distances(const T* s, const T* d, T inverse, T* dual) const {
    T sum = 0;
    for (int k = 0; k < pairs(); ++k) {
      dual[k] *= s[k];
      sum += dual[k] * d[k];
    }
    sum *= inverse * inverse / static_cast<T>(pairs());
    for (int k = 0; k < pairs(); ++k) dual[k] = sum - dual[k] * inverse;
  }

  /// Returns E and leaves dE/dD in warped_duals_ and, when asked for, in fixed_duals_.
  double compare(const T* weights, T* weight_gradient) {
    warped_duals_.resize(sites_ * pairs());
    if (weight_gradient) fixed_duals_.resize(sites_ * pairs());
    const T volume = static_cast<T>(lattice_.cell_volume()), share = 1 / static_cast<T>(pairs());
    return ordered_slabs([&](const Index<Dim>& index, std::size_t site) {
      T* dual = warped_duals_.data() + site * pairs();
      T* fixed_dual = weight_gradient ? fixed_duals_.data() + site * pairs() : nullptr;
      const T weight = weights ? weights[site] : T(1);
      if (weight == 0 && !weight_gradient) {
        std::fill_n(dual, pairs(), T(0));
        return 0.0;
      }
      const T* f = context_.data() + site * pairs();
      T d[kMostPairs + 2], s[kMostPairs + 2];
      const T inverse = 1 / (gather(warped_distances_, index, site, d) + static_cast<T>(warped_floor_));
      T squares = 0;
      for (int k = 0; k < pairs(); ++k) {
        s[k] = std::exp(-d[k] * inverse);
        const T difference = s[k] - f[k];
        squares += difference * difference;
        dual[k] = 2 * volume * weight * share * difference;
      }
      if (weight_gradient) {
        weight_gradient[site] = volume * share * squares;
        for (int k = 0; k < pairs(); ++k) fixed_dual[k] = -dual[k];
        T d_fixed[kMostPairs + 2];
        const T mean = gather(fixed_distances_, index, site, d_fixed);
        back_to_distances(f, d_fixed, 1 / (mean + static_cast<T>(fixed_floor_)), fixed_dual);
      }
      back_to_distances(s, d, inverse, dual);
      return static_cast<double>(volume) * weight * share * squares;
    });
  }

  /// dE/dD to dE/dI, written to `gradient` unless null, and dE/d weights, added. Uses up `distances`.
  void back_to_image(const T* image, const T* weights, std::vector<T>& distances, const std::vector<T>& duals,
                     T* gradient, T* weight_gradient) {
    const T scale = static_cast<T>(inverse_patch_);
    ordered_slabs([&](const Index<Dim>& index, std::size_t site) {
      const bool inside = is_inside(index);
      for (int j = 0; j < fields_; ++j) {
        T sum = 0;
        if (inside || reaches(index, directions_[j].v, 1))
          for (int k = 2 * j; k < 2 * j + 2; ++k)
            if (inside || reaches(index, directions_[j].place[k % 2], -1))
              sum += duals[(site - static_cast<std::size_t>(places_[k])) * pairs() + k];
        distances[site * fields_ + j] = scale * sum;
      }
      return 0.0;
    });
    box_.apply(fields_, distances.data());
    ordered_slabs([&](const Index<Dim>& index, std::size_t site) {
      const T weight = weights ? weights[site] : T(1);
      if (weight == 0 && !weight_gradient) return 0.0;
      const bool inside = is_inside(index);
      T image_part = 0, weight_part = 0;
      for (int j = 0; j < fields_; ++j)
        for (int sign : {1, -1}) {  // the difference that starts here, and the one that ends here
          if (!inside && !reaches(index, directions_[j].v, sign)) continue;
          const std::size_t other = site + static_cast<std::size_t>(sign * along_[j]);
          const T shown = weights ? weights[other] : T(1);
          if (shown == 0) continue;
          const T part = shown * (image[site] - image[other]) * distances[(sign > 0 ? site : other) * fields_ + j];
          image_part += part;
          weight_part += part * (image[site] - image[other]);
        }
      if (gradient) gradient[site] = weight == 0 ? T(0) : 2 * weight * image_part;
      if (weight_gradient) weight_gradient[site] += weight_part;
      return 0.0;
    });
  }

  /// Distances below this are noise, or small against what the image has elsewhere.
  double floor_of(const T* image, const T* weights) {
    patch_distances(image, weights, warped_distances_);
    T d[kMostPairs + 2];
    double sum = 0, seen = 0;
    for (int slab = 0; slab < lattice_.size[Dim - 1]; ++slab)
      visit_slab<Dim>(lattice_, slab, [&](const Index<Dim>& index, std::size_t site) {
        const double weight = weights ? double(weights[site]) : 1.0;
        if (weight == 0) return;
        sum += weight * gather(warped_distances_, index, site, d);
        seen += weight;
      });
    const double noise = noise_sd<Dim>(lattice_, image, weights);
    return seen > 0 ? 2 * noise * noise + kFloor * sum / seen : 0;
  }

  Lattice<Dim> lattice_;
  std::size_t sites_;
  std::vector<Direction<Dim>> directions_;
  int fields_;
  Index<Dim> radius_;
  BoxSum<Dim, T> box_;
  double inverse_patch_;
  Index<Dim> margin_;
  std::vector<std::ptrdiff_t> along_, places_;  ///< from a site to its partner, and to where a pair is read
  double fixed_floor_ = 0, warped_floor_ = 0;
  bool is_prepared_ = false;
  std::vector<T> context_, fixed_distances_, warped_distances_, warped_duals_, fixed_duals_;
};

}  // namespace

template <int Dim, class T>
std::unique_ptr<Similarity<Dim, T>> make_self_similarity(const Lattice<Dim>& lattice, double radius_mm,
                                                         double step_mm) {
  return std::make_unique<SelfSimilarity<Dim, T>>(lattice, radius_mm, step_mm);
}

template std::unique_ptr<Similarity<2, float>> make_self_similarity(const Lattice<2>&, double, double);
template std::unique_ptr<Similarity<3, float>> make_self_similarity(const Lattice<3>&, double, double);
template std::unique_ptr<Similarity<2, double>> make_self_similarity(const Lattice<2>&, double, double);
template std::unique_ptr<Similarity<3, double>> make_self_similarity(const Lattice<3>&, double, double);

}  // namespace saltus
