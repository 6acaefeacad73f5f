#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "core/grid/noise.h"
#include "core/similarity/box_sum.h"
#include "core/similarity/row_pieces.h"
#include "core/similarity/similarity.h"
#include "core/support/exponential.h"
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
/// The adjoint goes back through S, D, the box (its own transpose) and the differences. Fields of B, D and S lie one
/// after the other, so that a piece of a row meets its neighbours in lanes.
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
    is_context_of_all_ = false;
  }

  double evaluate(const T* fixed, const T* warped, const T* weights, T* gradient, T* weight_gradient) override {
    if (!is_prepared_) throw std::logic_error("self-similarity is evaluated before prepare");
    if (fields_ == 0) {  // a single sample is like nothing
      std::fill_n(gradient, sites_, T(0));
      if (weight_gradient) std::fill_n(weight_gradient, sites_, T(0));
      return 0;
    }
    // Masks change what the fixed image shows; as long as there are none its context is kept.
    if (weights || weight_gradient || !is_context_of_all_) {
      patch_distances(fixed, weights, fixed_distances_);
      describe(fixed_distances_, fixed_floor_, context_);
      is_context_of_all_ = !weights;
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

  using Piece = RowPiece<Dim>;
  /// A value for each pair and sample of a piece.
  using PairRows = T[kMostPairs + 2][kLongestPiece];

  /// Samples [begin, end) of a piece.
  struct Span {
    int begin, end;
  };
  /// Those that lie on the lattice when moved by sign * by.
  Span reaching(const Piece& piece, const Index<Dim>& by, int sign) const {
    for (int axis = 1; axis < Dim; ++axis) {
      const int at = piece.first[axis] + sign * by[axis];
      if (at < 0 || at >= lattice_.size[axis]) return {0, 0};
    }
    const int moved = piece.first[0] + sign * by[0], begin = std::clamp(-moved, 0, piece.length);
    return {begin, std::clamp(lattice_.size[0] - moved, begin, piece.length)};
  }
  static Span common(const Span& a, const Span& b) {
    const int begin = std::max(a.begin, b.begin);
    return {begin, std::max(begin, std::min(a.end, b.end))};
  }
  /// Those for which pair k is on the lattice.
  Span whole(const Piece& piece, int k) const {
    const Direction<Dim>& direction = directions_[static_cast<std::size_t>(k / 2)];
    return common(reaching(piece, direction.place[k % 2], 1), reaching(piece, direction.end[k % 2], 1));
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

  /// B_v at every site.
  void patch_distances(const T* image, const T* weights, std::vector<T>& distances) {
    distances.resize(sites_ * static_cast<std::size_t>(fields_));
    const T scale = static_cast<T>(inverse_patch_);
    sum_of_pieces(lattice_, [&](const Piece& piece) {
      const T* own = image + piece.site;
      for (std::size_t j = 0; j < directions_.size(); ++j) {
        T* to = distances.data() + j * sites_ + piece.site;
        const Span span = reaching(piece, directions_[j].v, 1);
        const T* other = own + along_[j];
        std::fill(to, to + span.begin, T(0));
        std::fill(to + span.end, to + piece.length, T(0));
        if (weights) {
          const T *of_own = weights + piece.site, *of_other = of_own + along_[j];
#pragma omp simd
          for (int i = span.begin; i < span.end; ++i) {
            const T shown = of_own[i] * of_other[i], difference = own[i] - other[i];
            // Not a product with 0: what is hidden may be NaN.
            to[i] = shown == 0 ? T(0) : scale * shown * difference * difference;
          }
        } else {
#pragma omp simd
          for (int i = span.begin; i < span.end; ++i) {
            const T difference = own[i] - other[i];
            to[i] = scale * difference * difference;
          }
        }
      }
      return 0.0;
    });
    for (std::size_t j = 0; j < directions_.size(); ++j) box_.apply(distances.data() + j * sites_);
  }

  /// The distances of the pairs of each sample, and 1 / (their mean + floor).
  void gather(const std::vector<T>& distances, const Piece& piece, double floor, PairRows& d, T* inverse) const {
    T sum[kLongestPiece] = {};
    for (int k = 0; k < pairs(); ++k) {
      const Span span = whole(piece, k);
      const T* from = distances.data() + static_cast<std::size_t>(k / 2) * sites_ + piece.site + places_[k];
      T* to = d[k];
      std::fill(to, to + span.begin, T(0));
      std::fill(to + span.end, to + piece.length, T(0));
#pragma omp simd
      for (int i = span.begin; i < span.end; ++i) {
        // Rounding in running sums may leave less than 0 where there is nothing; what is no number stays that.
        to[i] = from[i] < 0 ? T(0) : from[i];
        sum[i] += to[i];
      }
    }
    const T share = 1 / static_cast<T>(pairs()), least = static_cast<T>(floor);
#pragma omp simd
    for (int i = 0; i < piece.length; ++i) inverse[i] = 1 / (sum[i] * share + least);
  }

  void describe(const std::vector<T>& distances, double floor, std::vector<T>& context) {
    context.resize(sites_ * static_cast<std::size_t>(pairs()));
    sum_of_pieces(lattice_, [&](const Piece& piece) {
      PairRows d;
      T inverse[kLongestPiece];
      gather(distances, piece, floor, d, inverse);
      for (int k = 0; k < pairs(); ++k) {
        T* to = context.data() + static_cast<std::size_t>(k) * sites_ + piece.site;
#pragma omp simd
        for (int i = 0; i < piece.length; ++i) to[i] = exponential(-d[k][i] * inverse[i]);
      }
      return 0.0;
    });
  }

  /// dE/dS, times S, to dE/dD: dS_k/dD_l = S_k ( D_k / (V^2 K) - [k = l] / V ), V = mean(D) + floor.
  void put_duals(const Piece& piece, const PairRows& d, const T* inverse, const PairRows& by_descriptor,
                 std::vector<T>& duals) const {
    T sum[kLongestPiece] = {};
    for (int k = 0; k < pairs(); ++k)
#pragma omp simd
      for (int i = 0; i < piece.length; ++i) sum[i] += by_descriptor[k][i] * d[k][i];
    const T share = 1 / static_cast<T>(pairs());
#pragma omp simd
    for (int i = 0; i < piece.length; ++i) sum[i] *= inverse[i] * inverse[i] * share;
    for (int k = 0; k < pairs(); ++k) {
      T* to = duals.data() + static_cast<std::size_t>(k) * sites_ + piece.site;
#pragma omp simd
      for (int i = 0; i < piece.length; ++i) to[i] = sum[i] - by_descriptor[k][i] * inverse[i];
    }
  }

  /// Returns E and leaves dE/dD in warped_duals_ and, when asked for, in fixed_duals_: 0 where a sample is hidden,
  /// whose distances are those of what is shown around it and finite.
  double compare(const T* weights, T* weight_gradient) {
    const std::size_t all = sites_ * static_cast<std::size_t>(pairs());
    warped_duals_.resize(all);
    if (weight_gradient) fixed_duals_.resize(all);
    const T volume = static_cast<T>(lattice_.cell_volume()), share = 1 / static_cast<T>(pairs());
    return sum_of_pieces(lattice_, [&](const Piece& piece) {
      PairRows d, dual;
      T inverse[kLongestPiece], squares[kLongestPiece] = {}, weight[kLongestPiece];
      gather(warped_distances_, piece, warped_floor_, d, inverse);
      for (int i = 0; i < piece.length; ++i) weight[i] = weights ? weights[piece.site + i] : T(1);
      for (int k = 0; k < pairs(); ++k) {
        const T* f = context_.data() + static_cast<std::size_t>(k) * sites_ + piece.site;
#pragma omp simd
        for (int i = 0; i < piece.length; ++i) {
          const T s = exponential(-d[k][i] * inverse[i]), difference = s - f[i];
          squares[i] += difference * difference;
          dual[k][i] = 2 * volume * share * weight[i] * difference * s;
        }
      }
      put_duals(piece, d, inverse, dual, warped_duals_);
      if (weight_gradient) {
        // The same difference with the other sign, and the fixed image's S for the warped one's.
        for (int k = 0; k < pairs(); ++k) {
          const T* f = context_.data() + static_cast<std::size_t>(k) * sites_ + piece.site;
#pragma omp simd
          for (int i = 0; i < piece.length; ++i) {
            const T s = exponential(-d[k][i] * inverse[i]);
            dual[k][i] = -2 * volume * share * weight[i] * (s - f[i]) * f[i];
          }
        }
        gather(fixed_distances_, piece, fixed_floor_, d, inverse);
        put_duals(piece, d, inverse, dual, fixed_duals_);
        for (int i = 0; i < piece.length; ++i) weight_gradient[piece.site + i] = volume * share * squares[i];
      }
      double sum = 0;
#pragma omp simd reduction(+ : sum)
      for (int i = 0; i < piece.length; ++i) sum += static_cast<double>(volume * share * weight[i] * squares[i]);
      return sum;
    });
  }

  /// dE/dD to dE/dI, written to `gradient` unless null, and dE/d weights, added. Uses up `distances`.
  void back_to_image(const T* image, const T* weights, std::vector<T>& distances, const std::vector<T>& duals,
                     T* gradient, T* weight_gradient) {
    const T scale = static_cast<T>(inverse_patch_);
    sum_of_pieces(lattice_, [&](const Piece& piece) {
      for (std::size_t j = 0; j < directions_.size(); ++j) {
        T* to = distances.data() + j * sites_ + piece.site;
        std::fill_n(to, piece.length, T(0));
        const Span there = reaching(piece, directions_[j].v, 1);
        for (std::size_t side = 0; side < 2; ++side) {
          const std::size_t k = 2 * j + side;
          const Span span = common(there, reaching(piece, directions_[j].place[side], -1));
          const T* dual = duals.data() + k * sites_ + piece.site - places_[k];
#pragma omp simd
          for (int i = span.begin; i < span.end; ++i) to[i] += scale * dual[i];
        }
      }
      return 0.0;
    });
    for (std::size_t j = 0; j < directions_.size(); ++j) box_.apply(distances.data() + j * sites_);
    sum_of_pieces(lattice_, [&](const Piece& piece) {
      const T *own = image + piece.site, *of_own = weights ? weights + piece.site : nullptr;
      T image_part[kLongestPiece] = {}, weight_part[kLongestPiece] = {};
      for (std::size_t j = 0; j < directions_.size(); ++j)
        for (int sign : {1, -1}) {  // the difference that starts here, and the one that ends here
          const Span span = reaching(piece, directions_[j].v, sign);
          const std::ptrdiff_t far = sign * along_[j];
          const T* distance = distances.data() + j * sites_ + piece.site + (sign > 0 ? 0 : far);
          const auto add = [&](auto&& shown) {
#pragma omp simd
            for (int i = span.begin; i < span.end; ++i) {
              const T seen = shown(i), difference = own[i] - own[i + far];
              const T part = seen == 0 ? T(0) : seen * difference * distance[i];
              image_part[i] += part;
              weight_part[i] += seen == 0 ? T(0) : part * difference;
            }
          };
          if (of_own)
            add([of_own, far](int i) { return of_own[i + far]; });
          else
            add([](int) { return T(1); });
        }
      for (int i = 0; gradient && i < piece.length; ++i) {
        const T weight = of_own ? of_own[i] : T(1);
        gradient[piece.site + i] = weight == 0 ? T(0) : 2 * weight * image_part[i];
      }
      for (int i = 0; weight_gradient && i < piece.length; ++i) weight_gradient[piece.site + i] += weight_part[i];
      return 0.0;
    });
  }

  /// Distances below this are noise, or small against what the image has elsewhere.
  double floor_of(const T* image, const T* weights) {
    patch_distances(image, weights, warped_distances_);
    const auto shown_at = [&](std::size_t site) { return weights ? static_cast<double>(weights[site]) : 1.0; };
    const double seen = ordered_sum(sites_, shown_at);
    const double sum = sum_of_pieces(lattice_, [&](const Piece& piece) {
      PairRows d;
      T inverse[kLongestPiece];
      gather(warped_distances_, piece, 0, d, inverse);
      double of_piece = 0;
      for (int i = 0; i < piece.length; ++i) {
        const double weight = shown_at(piece.site + static_cast<std::size_t>(i));
        for (int k = 0; weight > 0 && k < pairs(); ++k) of_piece += weight * static_cast<double>(d[k][i]);
      }
      return of_piece / pairs();
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
  std::vector<std::ptrdiff_t> along_, places_;  ///< from a site to its partner, and to where a pair is read
  double fixed_floor_ = 0, warped_floor_ = 0;
  bool is_prepared_ = false, is_context_of_all_ = false;
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
