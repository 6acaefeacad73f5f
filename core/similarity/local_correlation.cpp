#include <algorithm>
#include <cmath>

#include "core/similarity/box_sum.h"
#include "core/similarity/similarity.h"
#include "core/support/reduction.h"

namespace saltus {
namespace {

/// With window sums S of the weighted images: mean f = S_f / S_w, var f = S_ff / S_w - mean^2, and so on;
/// q = ((var_f + e)(var_w + e))^-1/2, c = cov q. The derivative at sample y collects the windows x that hold y:
///     dc(x)/dw(y) = weight(y) / S_w(x) * ( q (f(y) - mean f) - c / (var_w + e) (w(y) - mean w) ),
/// whose sum over x is box sums of coefficients that depend on x alone.
/// Nothing of this sees a constant that is taken off an image; both lose their mean first, because the sums are stored
/// in T and a variance small against the mean would be lost in them.
template <int Dim, class T>
class LocalCorrelation final : public Similarity<Dim, T> {
 public:
  LocalCorrelation(const Lattice<Dim>& lattice, double radius_mm, double floor)
      : sites_(lattice.sites()),
        volume_(lattice.cell_volume()),
        floor2_(floor * floor),
        box_(lattice, window(lattice, radius_mm)),
        sums_(kSums * lattice.sites()) {}

  double evaluate(const T* fixed, const T* warped, const T* weights, T* gradient, T* weight_gradient) override {
    const T middle_f = weighted_mean(fixed, weights), middle_w = weighted_mean(warped, weights);
#pragma omp parallel for schedule(static)
    for (std::size_t i = 0; i < sites_; ++i) {
      const T weight = weights ? weights[i] : T(1);
      T* s = sums_.data() + kSums * i;
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
    box_.apply(kSums, sums_.data());

    // The coefficients of the derivative replace the sums in place.
    const double energy = ordered_sum(sites_, [&](std::size_t i) {
      T* s = sums_.data() + kSums * i;
      const double weight = weights ? double(weights[i]) : 1.0, count = s[0];
      if (!(count > 1e-6) || (weight == 0 && !weight_gradient)) {
        std::fill_n(s, kSums, T(0));
        if (weight_gradient) weight_gradient[i] = static_cast<T>(volume_);  // of a window that sees one sample, c is 0
        return volume_ * weight;
      }
      const double mean_f = s[1] / count, mean_w = s[2] / count;
      const double var_f = std::max(0.0, s[3] / count - mean_f * mean_f) + floor2_;
      const double var_w = std::max(0.0, s[4] / count - mean_w * mean_w) + floor2_;
      const double cov = s[5] / count - mean_f * mean_w;
      const double q = 1 / std::sqrt(var_f * var_w), c = cov * q;
      const double factor = volume_ * weight / count;
      const double a = factor * q, b = factor * c / var_w;
      s[0] = static_cast<T>(a);
      s[1] = static_cast<T>(b);
      s[2] = static_cast<T>(a * mean_f - b * mean_w);
      if (weight_gradient) {
        // dc/dweight(y) = [ q ((f-mf)(w-mw) - cov) - c/2 ((f-mf)^2 - v_f)/var_f - c/2 ((w-mw)^2 - v_w)/var_w ] / S_w
        const double d = factor * c / var_f;
        const double v_f = var_f - floor2_, v_w = var_w - floor2_;
        s[3] = static_cast<T>(d);
        s[4] = static_cast<T>(-a * mean_w + d * mean_f);
        s[5] = static_cast<T>(a * (mean_f * mean_w - cov) - 0.5 * d * (mean_f * mean_f - v_f) -
                              0.5 * b * (mean_w * mean_w - v_w));
        weight_gradient[i] = static_cast<T>(volume_ * (1 - c));
      }
      return volume_ * weight * (1 - c);
    });
    box_.apply(kSums, sums_.data());

#pragma omp parallel for schedule(static)
    for (std::size_t i = 0; i < sites_; ++i) {
      const T* s = sums_.data() + kSums * i;
      const T weight = weights ? weights[i] : T(1);
      const T f = fixed[i] - middle_f, w = warped[i] - middle_w;
      gradient[i] = weight == 0 ? T(0) : -weight * (f * s[0] - w * s[1] - s[2]);
      if (weight_gradient)
        weight_gradient[i] -= f * w * s[0] - T(0.5) * f * f * s[3] - T(0.5) * w * w * s[1] + f * s[4] - w * s[2] + s[5];
    }
    return energy;
  }

 private:
  static constexpr int kSums = 6;

  static Index<Dim> window(const Lattice<Dim>& lattice, double radius_mm) {
    Index<Dim> radius;
    for (int axis = 0; axis < Dim; ++axis)
      radius[axis] =
          lattice.size[axis] > 1 ? std::max(1, static_cast<int>(std::lround(radius_mm / lattice.spacing[axis]))) : 0;
    return radius;
  }

  /// 0 when nothing is seen.
  T weighted_mean(const T* image, const T* weights) const {
    const auto weight = [&](std::size_t i) { return weights ? double(weights[i]) : 1.0; };
    const double sum = ordered_sum(sites_, [&](std::size_t i) { return weight(i) > 0 ? weight(i) * image[i] : 0.0; });
    const double count = weights ? ordered_sum(sites_, weight) : static_cast<double>(sites_);
    return static_cast<T>(count > 0 ? sum / count : 0);
  }

  std::size_t sites_;
  double volume_, floor2_;
  BoxSum<Dim, T> box_;
  std::vector<T> sums_;
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
