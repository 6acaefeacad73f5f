#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "core/similarity/box_sum.h"
#include "core/similarity/similarity.h"

namespace saltus {
namespace {

/// With window sums S of the weighted images: mean f = S_f / S_w, var f = S_ff / S_w - mean^2, and so on;
/// q = ((var_f + e)(var_w + e))^-1/2, c = cov q. The derivative at sample y collects the windows x that hold y:
///     dc(x)/dw(y) = weight(y) / S_w(x) * ( q (f(y) - mean f) - c / (var_w + e) (w(y) - mean w) ),
/// whose sum over x is box sums of coefficients that depend on x alone.
/// Nothing of this sees a constant that is taken off an image; both lose their mean first, because the sums are stored
/// in T and a variance small against the mean would be lost in them.
///
/// A window sum is one along every axis, in any order. Three sweeps take them so that what lies between two of them
/// stays in cache, and memory sees the six sums and the coefficients once each:
///   1. plane by plane (of the last axis): products, and their sums within the plane;
///   2. strip by strip along the last axis: the sums' last axis, the coefficients, and the first axis of theirs;
///   3. plane by plane: the coefficients' sums within the plane, and the gradient.
/// A plane and a strip belong to one thread, whichever it is.
template <int Dim, class T>
class LocalCorrelation final : public Similarity<Dim, T> {
 public:
  LocalCorrelation(const Lattice<Dim>& lattice, double radius_mm, double floor)
      : lattice_(lattice),
        radius_(window(lattice, radius_mm)),
        sites_(lattice.sites()),
        planes_(lattice.size[Dim - 1]),
        plane_(sites_ / static_cast<std::size_t>(planes_)),
        volume_(lattice.cell_volume()),
        floor2_(floor * floor),
        sums_(kSums * sites_) {}

  double evaluate(const T* fixed, const T* warped, const T* weights, T* gradient, T* weight_gradient) override {
    const auto [middle_f, middle_w] = weighted_means(fixed, warped, weights);
    sum_within_planes(fixed, warped, weights, middle_f, middle_w);
    coefficients_.resize((weight_gradient ? 6 : 3) * sites_);
    const double energy =
        weight_gradient ? find_coefficients<6>(weights, weight_gradient) : find_coefficients<3>(weights, nullptr);
    if (weight_gradient)
      find_gradient<6>(fixed, warped, weights, middle_f, middle_w, gradient, weight_gradient);
    else
      find_gradient<3>(fixed, warped, weights, middle_f, middle_w, gradient, nullptr);
    return energy;
  }

 private:
  static constexpr std::size_t kSums = 6;
  static constexpr std::size_t kStrip = 32;  ///< sites side by side in a strip along the last axis

  static Index<Dim> window(const Lattice<Dim>& lattice, double radius_mm) {
    Index<Dim> radius;
    for (int axis = 0; axis < Dim; ++axis)
      radius[axis] =
          lattice.size[axis] > 1 ? std::max(1, static_cast<int>(std::lround(radius_mm / lattice.spacing[axis]))) : 0;
    return radius;
  }

  /// Of both images; 0 when nothing is seen.
  std::pair<T, T> weighted_means(const T* fixed, const T* warped, const T* weights) const {
    struct Sums {
      double weight = 0, fixed = 0, warped = 0;
    };
    constexpr std::size_t block = 4096;  // sums of blocks, in the same order for any number of threads
    const std::size_t blocks = (sites_ + block - 1) / block;
    std::vector<Sums> partial(blocks);
#pragma omp parallel for schedule(static)
    for (std::size_t b = 0; b < blocks; ++b) {
      Sums sums;
      const std::size_t end = std::min(sites_, (b + 1) * block);
      for (std::size_t i = b * block; i < end; ++i) {
        const double weight = weights ? double(weights[i]) : 1.0;
        sums.weight += weight;
        if (!(weight > 0)) continue;
        sums.fixed += weight * fixed[i];
        sums.warped += weight * warped[i];
      }
      partial[b] = sums;
    }
    Sums all;
    for (const Sums& sums : partial) all.weight += sums.weight, all.fixed += sums.fixed, all.warped += sums.warped;
    if (!(all.weight > 0)) return {T(0), T(0)};
    return {static_cast<T>(all.fixed / all.weight), static_cast<T>(all.warped / all.weight)};
  }

  /// Sweep 1: sums_ of windows that lie within a plane.
  void sum_within_planes(const T* fixed, const T* warped, const T* weights, T middle_f, T middle_w) {
    const auto nx = static_cast<std::size_t>(lattice_.size[0]);
#pragma omp parallel
    {
      std::vector<T> products(kSums * nx), rows(Dim == 3 ? kSums * plane_ : 0);
#pragma omp for schedule(static)
      for (int plane = 0; plane < planes_; ++plane) {
        const std::size_t first = static_cast<std::size_t>(plane) * plane_;
        T* into = Dim == 3 ? rows.data() : sums_.data() + kSums * first;
        for (std::size_t row = 0; row < plane_; row += nx) {
          for (std::size_t x = 0; x < nx; ++x) {
            const std::size_t i = first + row + x;
            const T weight = weights ? weights[i] : T(1);
            T* s = products.data() + kSums * x;
            if (weight == 0) {  // not a product with 0: what is hidden may be NaN
              std::fill_n(s, kSums, T(0));
              continue;
            }
            const T f = fixed[i] - middle_f, w = warped[i] - middle_w;
            s[0] = weight;
            s[1] = weight * f;
            s[2] = weight * w;
            s[3] = weight * f * f;
            s[4] = weight * w * w;
            s[5] = weight * f * w;
          }
          box_sum_rows(lattice_.size[0], radius_[0], kSums, products.data(), kSums, into + kSums * row, kSums);
        }
        if constexpr (Dim == 3)
          box_sum_rows(lattice_.size[1], radius_[1], kSums * nx, rows.data(), kSums * nx, sums_.data() + kSums * first,
                       kSums * nx);
      }
    }
  }

  /// Sweep 2: the energy; coefficients_ summed along the last axis, `Count` a site (6 with the gradient of the weights,
  /// of which weight_gradient gets the part that its own window has).
  template <std::size_t Count>
  double find_coefficients(const T* weights, T* weight_gradient) {
    const std::size_t strips = (plane_ + kStrip - 1) / kStrip;
    std::vector<double> energies(strips);
#pragma omp parallel
    {
      std::vector<T> sums(kSums * kStrip * static_cast<std::size_t>(planes_)),
          found(Count * kStrip * static_cast<std::size_t>(planes_));
#pragma omp for schedule(static)
      for (std::size_t strip = 0; strip < strips; ++strip) {
        const std::size_t first = strip * kStrip, width = std::min(kStrip, plane_ - first);
        box_sum_rows(planes_, radius_[Dim - 1], kSums * width, sums_.data() + kSums * first, kSums * plane_,
                     sums.data(), kSums * width);
        double energy = 0;
        for (int plane = 0; plane < planes_; ++plane) {
          const std::size_t at = static_cast<std::size_t>(plane) * plane_ + first;
          energy += coefficients_of<Count>(width, sums.data() + kSums * width * static_cast<std::size_t>(plane),
                                           weights ? weights + at : nullptr,
                                           found.data() + Count * width * static_cast<std::size_t>(plane),
                                           Count == 6 ? weight_gradient + at : nullptr);
        }
        energies[strip] = energy;
        box_sum_rows(planes_, radius_[Dim - 1], Count * width, found.data(), Count * width,
                     coefficients_.data() + Count * first, Count * plane_);
      }
    }
    double energy = 0;
    for (double part : energies) energy += part;
    return energy;
  }

  /// Of `width` windows side by side, in double. Loops over arrays of one quantity each run in lanes.
  template <std::size_t Count>
  double coefficients_of(std::size_t width, const T* sums, const T* weights, T* found, T* weight_gradient) const {
    double s[kSums][kStrip], weight[kStrip], k[Count][kStrip], correlation[kStrip];
    for (std::size_t j = 0; j < width; ++j) {
      for (std::size_t channel = 0; channel < kSums; ++channel) s[channel][j] = sums[kSums * j + channel];
      weight[j] = weights ? double(weights[j]) : 1.0;
    }
#pragma omp simd
    for (std::size_t j = 0; j < width; ++j) {
      const bool sees = (s[0][j] > 1e-6) & (Count == 6 || weight[j] != 0);  // else c is 0
      const double share = sees ? 1 / s[0][j] : 0.0;
      const double mean_f = s[1][j] * share, mean_w = s[2][j] * share;
      const double v_f = std::max(0.0, s[3][j] * share - mean_f * mean_f),
                   v_w = std::max(0.0, s[4][j] * share - mean_w * mean_w);
      const double var_f = v_f + floor2_, var_w = v_w + floor2_;
      const double cov = s[5][j] * share - mean_f * mean_w;
      const double q2 = 1 / (var_f * var_w), q = std::sqrt(q2), c = cov * q;
      const double factor = volume_ * weight[j] * share;
      const double a = factor * q, b = factor * c * (q2 * var_f);
      correlation[j] = sees ? c : 0.0;
      k[0][j] = a;
      k[1][j] = b;
      k[2][j] = a * mean_f - b * mean_w;
      if constexpr (Count == 6) {
        // dc/dweight(y) = [ q ((f-mf)(w-mw) - cov) - c/2 ((f-mf)^2 - v_f)/var_f - c/2 ((w-mw)^2 - v_w)/var_w ] / S_w
        const double d = factor * c * (q2 * var_w);
        k[3][j] = d;
        k[4][j] = -a * mean_w + d * mean_f;
        k[5][j] = a * (mean_f * mean_w - cov) - 0.5 * d * (mean_f * mean_f - v_f) - 0.5 * b * (mean_w * mean_w - v_w);
      }
    }
    double energy = 0;
    for (std::size_t j = 0; j < width; ++j) {
      for (std::size_t channel = 0; channel < Count; ++channel)
        found[Count * j + channel] = static_cast<T>(k[channel][j]);
      energy += volume_ * weight[j] * (1 - correlation[j]);
      if constexpr (Count == 6) weight_gradient[j] = static_cast<T>(volume_ * (1 - correlation[j]));
    }
    return energy;
  }

  /// Sweep 3: what is left of the coefficients' sums, and the gradients that they are for.
  template <std::size_t Count>
  void find_gradient(const T* fixed, const T* warped, const T* weights, T middle_f, T middle_w, T* gradient,
                     T* weight_gradient) {
    const auto nx = static_cast<std::size_t>(lattice_.size[0]);
#pragma omp parallel
    {
      std::vector<T> rows(Dim == 3 ? Count * plane_ : 0), row_sums(Count * nx);
#pragma omp for schedule(static)
      for (int plane = 0; plane < planes_; ++plane) {
        const std::size_t first = static_cast<std::size_t>(plane) * plane_;
        const T* from = coefficients_.data() + Count * first;
        if constexpr (Dim == 3) {
          box_sum_rows(lattice_.size[1], radius_[1], Count * nx, from, Count * nx, rows.data(), Count * nx);
          from = rows.data();
        }
        for (std::size_t row = 0; row < plane_; row += nx) {
          box_sum_rows(lattice_.size[0], radius_[0], Count, from + Count * row, Count, row_sums.data(), Count);
          for (std::size_t x = 0; x < nx; ++x) {
            const std::size_t i = first + row + x;
            const T* s = row_sums.data() + Count * x;
            const T weight = weights ? weights[i] : T(1);
            const T f = fixed[i] - middle_f, w = warped[i] - middle_w;
            gradient[i] = weight == 0 ? T(0) : -weight * (f * s[0] - w * s[1] - s[2]);
            if constexpr (Count == 6)
              weight_gradient[i] -=
                  f * w * s[0] - T(0.5) * f * f * s[3] - T(0.5) * w * w * s[1] + f * s[4] - w * s[2] + s[5];
          }
        }
      }
    }
  }

  Lattice<Dim> lattice_;
  Index<Dim> radius_;
  std::size_t sites_;
  int planes_;         ///< along the last axis
  std::size_t plane_;  ///< sites of each
  double volume_, floor2_;
  std::vector<T> sums_, coefficients_;
};

}  // namespace

template <int Dim, class T>
std::unique_ptr<Similarity<Dim, T>> make_local_correlation(const Lattice<Dim>& lattice, double radius_mm,
                                                           double floor) {
  return std::make_unique<LocalCorrelation<Dim, T>>(lattice, radius_mm, floor);
}

template std::unique_ptr<Similarity<2, float>> make_local_correlation(const Lattice<2>&, double, double);
template std::unique_ptr<Similarity<3, float>> make_local_correlation(const Lattice<3>&, double, double);
template std::unique_ptr<Similarity<2, double>> make_local_correlation(const Lattice<2>&, double, double);
template std::unique_ptr<Similarity<3, double>> make_local_correlation(const Lattice<3>&, double, double);

}  // namespace saltus
