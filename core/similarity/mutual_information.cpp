#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "core/grid/intensity_range.h"
#include "core/similarity/similarity.h"

namespace saltus {
namespace {

/// Where an intensity lies among the bins, and how fast it moves there.
struct Place {
  double coordinate, slope;
};

/// [low, high] is the middle of the axis; what lies beyond is drawn together smoothly, so that everything has a bin.
class BinAxis {
 public:
  BinAxis() = default;
  /// Coordinates run from `first` to `last`.
  BinAxis(const IntensityRange& range, double width, double first, double last)
      : low_(range.low), inverse_(1 / width), first_(first), last_(last), scale_((last - first) / (1 + 2 * kTail)) {}

  Place operator()(double value) const {
    const double u = (value - low_) * inverse_;
    double place = u, slope = 1;
    if (u < 0 || u > 1) {
      // x / sqrt(1 + x^2) of the distance x in tails: at the end of the range slope 1 and no curvature, 1 at infinity.
      const double x = (u < 0 ? u : u - 1) / kTail, root = std::sqrt(1 + x * x);
      place = (u < 0 ? 0 : 1) + kTail * x / root;
      slope = 1 / (root * root * root);
    }
    return {std::clamp(first_ + (place + kTail) * scale_, first_, last_), slope * inverse_ * scale_};
  }

 private:
  static constexpr double kTail = 0.25;  ///< share of the range that each tail gets
  double low_ = 0, inverse_ = 0, first_ = 0, last_ = 0, scale_ = 0;
};

/// The whole part, `most` at most; of what is no number `least`, so that its bins exist and its weights say so.
int whole_part(double coordinate, int least, int most) {
  return coordinate >= least ? std::min(static_cast<int>(coordinate), most) : least;
}

/// Cubic B-spline weights of the four bins from floor(coordinate) - 1 on.
struct CubicWindow {
  int begin;
  double value[4], slope[4];

  CubicWindow(double coordinate, int bins) {
    const int cell = whole_part(coordinate, 1, bins - 3);
    const double t = coordinate - cell, s = 1 - t;
    begin = cell - 1;
    value[0] = s * s * s / 6;
    value[1] = (4 - 6 * t * t + 3 * t * t * t) / 6;
    value[2] = (4 - 6 * s * s + 3 * s * s * s) / 6;
    value[3] = t * t * t / 6;
    slope[0] = -s * s / 2;
    slope[1] = (-4 * t + 3 * t * t) / 2;
    slope[2] = (4 * s - 3 * s * s) / 2;
    slope[3] = t * t / 2;
  }
};

/// Hat weights of the two bins from floor(coordinate) on.
struct LinearWindow {
  int begin;
  double value[2];

  LinearWindow(double coordinate, int bins) {
    begin = whole_part(coordinate, 0, bins - 2);
    value[1] = coordinate - begin;
    value[0] = 1 - value[1];
  }
};

/// Q_kl = sum of weight b_k(f) c_l(w) + kPrior W / bins^2, with W the sum of the weights; W' = (1 + kPrior) W.
/// E = -V / (1 + kPrior) G,  G = sum of Q_kl log( Q_kl W' / (Q_k Q_l) ). G is homogeneous of degree 1, therefore
///     dG/dQ_kl = L_kl = log( Q_kl W' / (Q_k Q_l) ), and through the prior every weight also adds kPrior mean(L).
template <int Dim, class T>
class MutualInformation final : public Similarity<Dim, T> {
 public:
  MutualInformation(const Lattice<Dim>& lattice, int bins)
      : sites_(lattice.sites()),
        volume_(lattice.cell_volume()),
        bins_(bins),
        block_((sites_ + kBlocks - 1) / kBlocks),
        joint_(static_cast<std::size_t>(bins) * bins) {}

  void prepare(const T* fixed, const T* resting, const T* weights) override {
    const IntensityRange f = intensity_range(sites_, fixed, weights), w = intensity_range(sites_, resting, weights);
    is_prepared_ = true;
    is_flat_ = !(f.width() > 0);
    if (is_flat_) return;
    fixed_axis_ = BinAxis(f, f.width(), 0, bins_ - 1);
    // A window around the first and the last place still has all of its bins.
    warped_axis_ = BinAxis(w, w.width() > 0 ? w.width() : f.width(), 1, bins_ - 2);
  }

  double evaluate(const T* fixed, const T* warped, const T* weights, T* gradient, T* weight_gradient) override {
    if (!is_prepared_) throw std::logic_error("mutual information is evaluated before prepare");
    const double seen = is_flat_ ? 0 : fill_joint(fixed, warped, weights);
    if (!(seen > 0)) {
      std::fill_n(gradient, sites_, T(0));
      if (weight_gradient) std::fill_n(weight_gradient, sites_, T(0));
      return 0;
    }
    const double information = replace_joint_by_derivative(seen), factor = -volume_ / (1 + kPrior);
#pragma omp parallel for schedule(static)
    for (std::size_t i = 0; i < sites_; ++i) {
      const double weight = weights ? double(weights[i]) : 1.0;
      gradient[i] = 0;
      if (weight == 0 && !weight_gradient) continue;
      const LinearWindow f(fixed_axis_(fixed[i]).coordinate, bins_);
      const Place place = warped_axis_(warped[i]);
      const CubicWindow w(place.coordinate, bins_);
      double value = 0, slope = 0;
      for (int k = 0; k < 2; ++k) {
        const double* row = joint_.data() + static_cast<std::size_t>(f.begin + k) * bins_ + w.begin;
        double row_value = 0, row_slope = 0;
        for (int l = 0; l < 4; ++l) row_value += w.value[l] * row[l], row_slope += w.slope[l] * row[l];
        value += f.value[k] * row_value;
        slope += f.value[k] * row_slope;
      }
      if (weight > 0) gradient[i] = static_cast<T>(factor * weight * slope * place.slope);
      if (weight_gradient) weight_gradient[i] = static_cast<T>(factor * (value + prior_part_));
    }
    return factor * information;
  }

 private:
  static constexpr std::size_t kBlocks = 32;  ///< histograms that are filled side by side, whatever the threads
  static constexpr double kPrior = 1e-3;      ///< share of the samples that are spread evenly over all bins

  /// Fills joint_ (without the prior) and gives the sum of the weights.
  double fill_joint(const T* fixed, const T* warped, const T* weights) {
    const std::size_t size = joint_.size();
    partial_.assign(kBlocks * (size + 1), 0.0);
#pragma omp parallel for schedule(static)
    for (std::size_t b = 0; b < kBlocks; ++b) {
      double* table = partial_.data() + b * (size + 1);
      const std::size_t end = std::min(sites_, (b + 1) * block_);
      for (std::size_t i = b * block_; i < end; ++i) {
        const double weight = weights ? double(weights[i]) : 1.0;
        if (!(weight > 0)) continue;
        const LinearWindow f(fixed_axis_(fixed[i]).coordinate, bins_);
        const CubicWindow w(warped_axis_(warped[i]).coordinate, bins_);
        for (int k = 0; k < 2; ++k) {
          double* row = table + static_cast<std::size_t>(f.begin + k) * bins_ + w.begin;
          for (int l = 0; l < 4; ++l) row[l] += weight * f.value[k] * w.value[l];
        }
        table[size] += weight;
      }
    }
    std::fill(joint_.begin(), joint_.end(), 0.0);
    double seen = 0;
    for (std::size_t b = 0; b < kBlocks; ++b) {
      const double* table = partial_.data() + b * (size + 1);
      for (std::size_t k = 0; k < size; ++k) joint_[k] += table[k];
      seen += table[size];
    }
    return seen;
  }

  /// Returns G; joint_ holds L and prior_part_ kPrior mean(L) afterwards.
  double replace_joint_by_derivative(double seen) {
    const double added = kPrior * seen / static_cast<double>(joint_.size()), whole = (1 + kPrior) * seen;
    std::vector<double> rows(bins_, 0.0), columns(bins_, 0.0);
    for (int k = 0; k < bins_; ++k)
      for (int l = 0; l < bins_; ++l) {
        const double mass = joint_[static_cast<std::size_t>(k) * bins_ + l] += added;
        rows[k] += mass;
        columns[l] += mass;
      }
    double information = 0, sum = 0;
    for (int k = 0; k < bins_; ++k)
      for (int l = 0; l < bins_; ++l) {
        double& entry = joint_[static_cast<std::size_t>(k) * bins_ + l];
        const double ratio = std::log(entry * whole / (rows[k] * columns[l]));
        information += entry * ratio;
        sum += ratio;
        entry = ratio;
      }
    prior_part_ = kPrior * sum / static_cast<double>(joint_.size());
    return information;
  }

  std::size_t sites_;
  double volume_;
  int bins_;
  std::size_t block_;
  std::vector<double> joint_, partial_;
  BinAxis fixed_axis_, warped_axis_;
  double prior_part_ = 0;
  bool is_prepared_ = false, is_flat_ = false;
};

}  // namespace

template <int Dim, class T>
std::unique_ptr<Similarity<Dim, T>> make_mutual_information(const Lattice<Dim>& lattice, int bins) {
  return std::make_unique<MutualInformation<Dim, T>>(lattice, bins);
}

template std::unique_ptr<Similarity<2, float>> make_mutual_information(const Lattice<2>&, int);
template std::unique_ptr<Similarity<3, float>> make_mutual_information(const Lattice<3>&, int);
template std::unique_ptr<Similarity<2, double>> make_mutual_information(const Lattice<2>&, int);
template std::unique_ptr<Similarity<3, double>> make_mutual_information(const Lattice<3>&, int);

}  // namespace saltus
