#include <algorithm>
#include <cmath>

#include "core/similarity/similarity.h"
#include "core/support/reduction.h"

namespace saltus {
namespace {

/// With weighted means, variances v and covariance over the count S = sum of weights, and
/// q = ((v_f + e)(v_w + e))^-1/2, c = cov q, E = V S (1 - c):
///     dE/dw(y)      = -V weight(y) ( q (f - mean f) - c / (v_w + e) (w - mean w) )
///     dE/dweight(y) = V ( 1 - c - [ q ((f-mf)(w-mw) - cov) - c/2 ((f-mf)^2 - v_f)/(v_f+e) - c/2 (the same of w) ] ).
template <int Dim, class T>
class GlobalCorrelation final : public Similarity<Dim, T> {
 public:
  GlobalCorrelation(const Lattice<Dim>& lattice, double floor)
      : sites_(lattice.sites()), volume_(lattice.cell_volume()), floor2_(floor * floor) {}

  double evaluate(const T* fixed, const T* warped, const T* weights, T* gradient, T* weight_gradient) override {
    const auto weight = [&](std::size_t i) { return weights ? double(weights[i]) : 1.0; };
    const auto mean = [&](double count, auto&& term) {
      return ordered_sum(sites_, [&](std::size_t i) { return weight(i) > 0 ? weight(i) * term(i) : 0.0; }) / count;
    };
    const double count = weights ? ordered_sum(sites_, weight) : static_cast<double>(sites_);
    if (!(count > 0)) {  // the first sample to be seen has no variance, so c is 0
      std::fill_n(gradient, sites_, T(0));
      if (weight_gradient) std::fill_n(weight_gradient, sites_, static_cast<T>(volume_));
      return 0;
    }
    const double mean_f = mean(count, [&](std::size_t i) { return double(fixed[i]); });
    const double mean_w = mean(count, [&](std::size_t i) { return double(warped[i]); });
    const auto f = [&](std::size_t i) { return fixed[i] - mean_f; };
    const auto w = [&](std::size_t i) { return warped[i] - mean_w; };
    const double var_f = mean(count, [&](std::size_t i) { return f(i) * f(i); });
    const double var_w = mean(count, [&](std::size_t i) { return w(i) * w(i); });
    const double cov = mean(count, [&](std::size_t i) { return f(i) * w(i); });
    const double q = 1 / std::sqrt((var_f + floor2_) * (var_w + floor2_)), c = cov * q;
    const double share_f = c / (var_f + floor2_), share_w = c / (var_w + floor2_);
#pragma omp parallel for schedule(static)
    for (std::size_t i = 0; i < sites_; ++i) {
      gradient[i] = weight(i) > 0 ? static_cast<T>(-volume_ * weight(i) * (q * f(i) - share_w * w(i))) : T(0);
      if (!weight_gradient) continue;
      const double change =
          q * (f(i) * w(i) - cov) - 0.5 * share_f * (f(i) * f(i) - var_f) - 0.5 * share_w * (w(i) * w(i) - var_w);
      weight_gradient[i] = static_cast<T>(volume_ * (1 - c - change));
    }
    return volume_ * count * (1 - c);
  }

 private:
  std::size_t sites_;
  double volume_, floor2_;
};

}  // namespace

template <int Dim, class T>
std::unique_ptr<Similarity<Dim, T>> make_global_correlation(const Lattice<Dim>& lattice, double floor) {
  return std::make_unique<GlobalCorrelation<Dim, T>>(lattice, floor);
}

template std::unique_ptr<Similarity<2, float>> make_global_correlation(const Lattice<2>&, double);
template std::unique_ptr<Similarity<3, float>> make_global_correlation(const Lattice<3>&, double);
template std::unique_ptr<Similarity<2, double>> make_global_correlation(const Lattice<2>&, double);
template std::unique_ptr<Similarity<3, double>> make_global_correlation(const Lattice<3>&, double);

}  // namespace saltus
