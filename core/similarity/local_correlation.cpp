#include "core/similarity/row_window.h"
#include "core/similarity/similarity.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <tuple>
#include <utility>
#include <vector>

#include <omp.h>

namespace saltus {
namespace {

/// With window sums S of the weighted images: mean f = S_f / S_w, var f = S_ff / S_w - mean^2, and so on;
/// q = ((var_f + e)(var_w + e))^-1/2, c = cov q. The derivative at sample y collects the windows x that hold y:
///     dc(x)/dw(y) = weight(y) / S_w(x) * ( q (f(y) - mean f) - c / (var_w + e) (w(y) - mean w) ),
/// whose sum over x is box sums of coefficients that depend on x alone.
/// Nothing of this sees a constant that is taken off an image; both lose their mean first, because sums are stored in T
/// and a variance small against the mean would be lost in them.
///
/// One sweep along the last axis ("planes") does it all, so that memory sees both images and the gradient and nothing
/// else. When plane p comes in, each row of it goes through the whole chain: products enter the sums along z of this
/// row (those of plane p - 2 r - 1, made once more, leave them); these enter the sums along y, which are complete for
/// the row r before; summed along x they give the coefficients of plane p - r. Those take the same way, along y, then
/// z, then x, and end as the gradient of plane p - 2 r. Only sums along z and the coefficients of as many planes as a
/// window is wide have to wait. The lattice is swept in tiles, bands of rows that are as high as the cache allows; a
/// tile works out what its neighbours' windows need of it for itself.
///
/// Images of two dimensions are rows that are one plane each.
template <int Dim, class T>
class LocalCorrelation final : public Similarity<Dim, T> {
 public:
  LocalCorrelation(const Lattice<Dim>& lattice, double radius_mm, double floor)
      : sites_(lattice.sites()), volume_(lattice.cell_volume()), floor2_(floor * floor) {
    size_[0] = lattice.size[0];
    size_[2] = lattice.size[Dim - 1];
    if constexpr (Dim == 3) size_[1] = lattice.size[1];
    const auto radius = [&](int axis) {
      if (lattice.size[axis] < 2) return 0;
      const long samples = std::max(1l, std::lround(radius_mm / lattice.spacing[axis]));
      return static_cast<int>(std::min(samples, static_cast<long>(lattice.size[axis]) - 1));
    };
    radius_[0] = radius(0);
    radius_[2] = radius(Dim - 1);
    if constexpr (Dim == 3) radius_[1] = radius(1);
    stride_ = (static_cast<std::size_t>(size_[0]) + 15) / 16 * 16;
    for (int x = 0; x < size_[0]; ++x) inverse_widths_.push_back(T(1) / static_cast<T>(window_count(0, x)));
    ones_.assign(static_cast<std::size_t>(size_[0]), T(1));
    make_tiles();
  }

  double evaluate(const T* fixed, const T* warped, const T* weights, T* gradient, T* weight_gradient) override {
    Scene scene{fixed, warped, weights, gradient, weight_gradient, T(0), T(0)};
    std::tie(scene.middle_fixed, scene.middle_warped) = weighted_means(fixed, warped, weights);
    if (weight_gradient) return sweep<6, 6>(scene);
    return weights ? sweep<6, 3>(scene) : sweep<5, 3>(scene);
  }

 private:
  /// Sums: f, w, f^2, w^2, f w and, with weights, the weight. Coefficients: 3, or 6 with the gradient of the weights.
  static constexpr std::size_t kMostSums = 6, kMostCoefficients = 6;
  static constexpr std::size_t kCacheBytes = 640 * 1024;  ///< of a second-level cache, for a tile's planes
  static constexpr int kMostPlanes = 64;                  ///< of a tile

  struct Scene {
    const T *fixed, *warped, *weights;
    T *gradient, *weight_gradient;
    T middle_fixed, middle_warped;
  };
  struct Range {
    int begin = 0, end = 0;
    bool holds(int i) const { return begin <= i && i < end; }
    Range grown(int by, int size) const { return {std::max(0, begin - by), std::min(size, end + by)}; }
    int count() const { return end - begin; }
  };
  struct Tile {
    Range rows, planes;
  };
  /// What a thread keeps of the tile it is at. Rows of one quantity after the other, `stride_` apart.
  struct Work {
    std::vector<double> product_sums, coefficient_sums;          ///< along z, of each row
    std::vector<double> product_row_sums, coefficient_row_sums;  ///< along y as well, of the row at hand
    std::vector<T> coefficient_rows, coefficient_planes;         ///< the last rows; the last planes, summed along y
    std::vector<T> padded, summed;                               ///< for the sums along x
  };

  void make_tiles() {
    // Rows that the cache holds: those of five products go beyond a tile by two radii on both sides.
    const std::size_t products = 5 * sizeof(double);
    const std::size_t coefficients = 3 * (static_cast<std::size_t>(2 * radius_[2] + 2) * sizeof(T) + sizeof(double));
    const long rows = static_cast<long>(kCacheBytes / stride_) - 4 * radius_[1] * static_cast<long>(products);
    const long fit = rows / static_cast<long>(products + coefficients);
    const int least = std::max(8, 2 * radius_[1]);  // a tile's own rows are worth those beside it
    const int height = static_cast<int>(std::clamp<long>(fit, least, std::max(least, (size_[1] + 1) / 2)));
    const int bands = (size_[1] + height - 1) / height, chunks = (size_[2] + kMostPlanes - 1) / kMostPlanes;
    for (int chunk = 0; chunk < chunks; ++chunk)
      for (int band = 0; band < bands; ++band)
        tiles_.push_back({{size_[1] * band / bands, size_[1] * (band + 1) / bands},
                          {size_[2] * chunk / chunks, size_[2] * (chunk + 1) / chunks}});
  }

  /// Of both images; 0 when nothing is seen.
  std::pair<T, T> weighted_means(const T* fixed, const T* warped, const T* weights) const {
    constexpr std::size_t block = 4096;  // sums of blocks, in the same order for any number of threads
    const std::size_t blocks = (sites_ + block - 1) / block;
    std::vector<std::array<double, 3>> partial(blocks);
#pragma omp parallel for schedule(static)
    for (std::size_t b = 0; b < blocks; ++b) {
      const std::size_t first = b * block, count = std::min(block, sites_ - first);
      const T *f = fixed + first, *w = warped + first, *weight = weights ? weights + first : nullptr;
      double all = 0, sum_f = 0, sum_w = 0;
      if (weight) {
#pragma omp simd reduction(+ : all, sum_f, sum_w)
        for (std::size_t i = 0; i < count; ++i) {
          const double share = weight[i];
          all += share;
          sum_f += share > 0 ? share * double(f[i]) : 0.0;
          sum_w += share > 0 ? share * double(w[i]) : 0.0;
        }
      } else {
        all = static_cast<double>(count);
#pragma omp simd reduction(+ : sum_f, sum_w)
        for (std::size_t i = 0; i < count; ++i) {
          sum_f += double(f[i]);
          sum_w += double(w[i]);
        }
      }
      partial[b] = {all, sum_f, sum_w};
    }
    std::array<double, 3> sums{};
    for (const auto& part : partial)
      for (std::size_t k = 0; k < 3; ++k) sums[k] += part[k];
    if (!(sums[0] > 0)) return {T(0), T(0)};
    return {static_cast<T>(sums[1] / sums[0]), static_cast<T>(sums[2] / sums[0])};
  }

  template <std::size_t Sums, std::size_t Coefficients>
  double sweep(const Scene& scene) {
    work_.resize(static_cast<std::size_t>(std::max(omp_get_max_threads(), static_cast<int>(work_.size()))));
    std::vector<double> energies(tiles_.size());
#pragma omp parallel for schedule(dynamic, 1)
    for (std::size_t i = 0; i < tiles_.size(); ++i)
      energies[i] =
          sweep_tile<Sums, Coefficients>(scene, tiles_[i], work_[static_cast<std::size_t>(omp_get_thread_num())]);
    double energy = 0;
    for (double part : energies) energy += part;
    return energy;
  }

  template <std::size_t Sums, std::size_t Coefficients>
  double sweep_tile(const Scene& scene, const Tile& tile, Work& work) const {
    const int ry = radius_[1], rz = radius_[2];
    const Range rows = tile.rows.grown(2 * ry, size_[1]), windows = tile.rows.grown(ry, size_[1]);
    const Range planes = tile.planes.grown(2 * rz, size_[2]), centres = tile.planes.grown(rz, size_[2]);
    clear<Sums, Coefficients>(tile, work);
    const auto product_sums = [&](int row) {
      return work.product_sums.data() + static_cast<std::size_t>(row - rows.begin) * Sums * stride_;
    };
    const auto coefficient_row = [&](int row) {
      return work.coefficient_rows.data() + static_cast<std::size_t>(row % (2 * ry + 2)) * Coefficients * stride_;
    };
    double energy = 0;
    for (int plane = planes.begin; plane < tile.planes.end + 2 * rz; ++plane) {
      const int centre = plane - rz, left = centre - rz - 1;
      std::fill_n(work.product_row_sums.begin(), Sums * stride_, 0.0);
      std::fill_n(work.coefficient_row_sums.begin(), Coefficients * stride_, 0.0);
      for (int row = rows.begin; row < tile.rows.end + 2 * ry; ++row) {
        if (rows.holds(row)) {
          if (planes.holds(plane) && rows.holds(row + 1)) prefetch(scene, first_of(row + 1, plane));
          if (planes.holds(plane)) add_products<Sums, 1>(scene, first_of(row, plane), product_sums(row));
          if (planes.holds(left)) add_products<Sums, -1>(scene, first_of(row, left), product_sums(row));
        }
        const int own = row - 2 * ry;
        if (centres.holds(centre)) {
          const int window = row - ry, gone = own - 1;
          slide_window<double>(Sums * stride_, rows.holds(row) ? product_sums(row) : nullptr,
                               rows.holds(gone) ? product_sums(gone) : nullptr, work.product_row_sums.data());
          if (windows.holds(window)) {
            for (std::size_t k = 0; k < Sums; ++k) sum_along_x(work.product_row_sums.data() + k * stride_, work, k);
            energy += coefficients_of<Sums, Coefficients>(scene, window, centre,
                                                          tile.rows.holds(window) && tile.planes.holds(centre),
                                                          work.summed.data(), coefficient_row(window));
          }
          const int behind = window - 2 * ry - 1;
          slide_window<T>(Coefficients * stride_, windows.holds(window) ? coefficient_row(window) : nullptr,
                          windows.holds(behind) ? coefficient_row(behind) : nullptr, work.coefficient_row_sums.data());
        }
        if (tile.rows.holds(own)) finish_row<Coefficients>(scene, tile, own, centre, work);
      }
    }
    return energy;
  }

  /// Takes a row of coefficients summed along y into the sums along z, and gives the gradient that is then complete.
  template <std::size_t Coefficients>
  void finish_row(const Scene& scene, const Tile& tile, int row, int centre, Work& work) const {
    const int rz = radius_[2];
    const Range centres = tile.planes.grown(rz, size_[2]);
    const auto own = static_cast<std::size_t>(row - tile.rows.begin),
               rows = static_cast<std::size_t>(tile.rows.count());
    const auto waiting = [&](int plane) {
      const auto slot = static_cast<std::size_t>(plane % (2 * rz + 2));
      return work.coefficient_planes.data() + (slot * rows + own) * Coefficients * stride_;
    };
    double* sums = work.coefficient_sums.data() + own * Coefficients * stride_;
    T* entering = centres.holds(centre) ? waiting(centre) : nullptr;
    if (entering) {
      const double* row_sums = work.coefficient_row_sums.data();
#pragma omp simd
      for (std::size_t x = 0; x < Coefficients * stride_; ++x) entering[x] = static_cast<T>(row_sums[x]);
    }
    const int at = centre - rz, left = at - rz - 1;
    slide_window<T>(Coefficients * stride_, entering, centres.holds(left) ? waiting(left) : nullptr, sums);
    if (tile.planes.holds(at)) give_gradient<Coefficients>(scene, row, at, sums, work);
  }

  template <std::size_t Sums, std::size_t Coefficients>
  void clear(const Tile& tile, Work& work) const {
    const auto rows = static_cast<std::size_t>(tile.rows.count());
    const auto product_rows = static_cast<std::size_t>(tile.rows.grown(2 * radius_[1], size_[1]).count());
    const auto fit = [](auto& values, std::size_t count) {
      if (values.size() < count) values.resize(count);
    };
    fit(work.product_row_sums, Sums * stride_);
    fit(work.coefficient_row_sums, Coefficients * stride_);
    fit(work.coefficient_rows, static_cast<std::size_t>(2 * radius_[1] + 2) * Coefficients * stride_);
    fit(work.coefficient_planes, static_cast<std::size_t>(2 * radius_[2] + 2) * rows * Coefficients * stride_);
    fit(work.padded, stride_ + 2 * static_cast<std::size_t>(radius_[0]));
    fit(work.summed, std::max(Sums, Coefficients) * stride_);
    work.product_sums.assign(product_rows * Sums * stride_, 0.0);
    work.coefficient_sums.assign(rows * Coefficients * stride_, 0.0);
  }

  /// A row of both images: rows are too short for the machine to foresee the next one.
  void prefetch(const Scene& scene, std::size_t first) const {
    for (std::size_t x = 0; x < static_cast<std::size_t>(size_[0]); x += 64 / sizeof(T)) {
      __builtin_prefetch(scene.fixed + first + x);
      __builtin_prefetch(scene.warped + first + x);
    }
  }

  /// Adds Sign times a row of products: rounded to T first, so that in float what entered leaves again without a trace.
  template <std::size_t Sums, int Sign>
  void add_products(const Scene& scene, std::size_t first, double* to) const {
    const T *fixed = scene.fixed + first, *warped = scene.warped + first;
    const T middle_f = scene.middle_fixed, middle_w = scene.middle_warped;
    const auto width = static_cast<std::size_t>(size_[0]);
    double *s_f = to, *s_w = to + stride_, *s_ff = to + 2 * stride_, *s_ww = to + 3 * stride_, *s_fw = to + 4 * stride_;
    if constexpr (Sums == 5) {
#pragma omp simd
      for (std::size_t x = 0; x < width; ++x) {
        const T f = fixed[x] - middle_f, w = warped[x] - middle_w, ff = f * f, ww = w * w, fw = f * w;
        s_f[x] += Sign * double(f);
        s_w[x] += Sign * double(w);
        s_ff[x] += Sign * double(ff);
        s_ww[x] += Sign * double(ww);
        s_fw[x] += Sign * double(fw);
      }
    } else {
      const T* weights = weights_from(scene, first);
      double* s_1 = to + 5 * stride_;
#pragma omp simd
      for (std::size_t x = 0; x < width; ++x) {
        const T weight = weights[x];
        const bool is_seen = weight != 0;  // not a product with 0: what is hidden may be NaN
        const T f = is_seen ? fixed[x] - middle_f : T(0), w = is_seen ? warped[x] - middle_w : T(0);
        const T wf = weight * f, ww = weight * w, wff = wf * f, www = ww * w, wfw = wf * w;
        s_f[x] += Sign * double(wf);
        s_w[x] += Sign * double(ww);
        s_ff[x] += Sign * double(wff);
        s_ww[x] += Sign * double(www);
        s_fw[x] += Sign * double(wfw);
        s_1[x] += Sign * double(weight);
      }
    }
  }

  void sum_along_x(const double* sums, Work& work, std::size_t channel) const {
    const auto width = static_cast<std::size_t>(size_[0]), radius = static_cast<std::size_t>(radius_[0]);
    T* padded = work.padded.data();
    std::fill_n(padded, radius, T(0));
#pragma omp simd
    for (std::size_t x = 0; x < width; ++x) padded[radius + x] = static_cast<T>(sums[x]);
    std::fill_n(padded + radius + width, radius, T(0));
    sum_along_row(width, radius_[0], padded, work.summed.data() + channel * stride_);
  }

  /// Of one row of windows. Without weights a window's are counted.
  template <std::size_t Sums, std::size_t Coefficients>
  double coefficients_of(const Scene& scene, int row, int plane, bool is_own, const T* sums, T* to) const {
    const auto width = static_cast<std::size_t>(size_[0]);
    const std::size_t first = first_of(row, plane);
    const T floor2 = static_cast<T>(floor2_), volume = static_cast<T>(volume_);
    const T across = T(1) / static_cast<T>(window_count(1, row) * window_count(2, plane));
    const auto quantity = [&](const T* rows, std::size_t k) { return rows + k * stride_; };
    const T *s_f = sums, *s_w = quantity(sums, 1), *s_ff = quantity(sums, 2), *s_ww = quantity(sums, 3),
            *s_fw = quantity(sums, 4), *s_1 = Sums == 6 ? quantity(sums, 5) : nullptr;
    const T *weights = Sums == 6 ? weights_from(scene, first) : nullptr, *inverse_widths = inverse_widths_.data();
    T *k_f = to, *k_w = to + stride_, *k_1 = to + 2 * stride_, *k_ff = to + 3 * stride_, *m_f = to + 4 * stride_,
      *m_1 = to + 5 * stride_;
    T* weight_gradient = Coefficients == 6 && is_own ? scene.weight_gradient + first : nullptr;
    double energy = 0;
#pragma omp simd reduction(+ : energy)
    for (std::size_t x = 0; x < width; ++x) {
      const T weight = Sums == 6 ? weights[x] : T(1);
      const T all = Sums == 6 ? s_1[x] : T(1);
      const bool sees = Sums == 5 || ((all > T(1e-6)) & (Coefficients == 6 || weight != 0));  // else c is 0
      const T share = Sums == 5 ? across * inverse_widths[x] : (sees ? 1 / all : T(0));
      const T mean_f = s_f[x] * share, mean_w = s_w[x] * share;
      const T e_f = s_ff[x] * share - mean_f * mean_f, e_w = s_ww[x] * share - mean_w * mean_w;
      const T v_f = e_f > 0 ? e_f : T(0), v_w = e_w > 0 ? e_w : T(0);
      const T var_f = v_f + floor2, var_w = v_w + floor2, cov = s_fw[x] * share - mean_f * mean_w;
      const T q2 = 1 / (var_f * var_w), q = std::sqrt(q2), c = cov * q;
      const T factor = volume * weight * share;
      const T a = factor * q, b = factor * c * (q2 * var_f);
      k_f[x] = a;
      k_w[x] = b;
      k_1[x] = a * mean_f - b * mean_w;
      if constexpr (Coefficients == 6) {
        // dc/dweight(y) = [ q ((f-mf)(w-mw) - cov) - c/2 ((f-mf)^2 - v_f)/var_f - c/2 ((w-mw)^2 - v_w)/var_w ] / S_w
        const T d = factor * c * (q2 * var_w);
        k_ff[x] = d;
        m_f[x] = d * mean_f - a * mean_w;
        m_1[x] = a * (mean_f * mean_w - cov) - T(0.5) * (d * (mean_f * mean_f - v_f) + b * (mean_w * mean_w - v_w));
      }
      const T rest = 1 - (sees ? c : T(0));
      energy += double(weight) * double(rest);
      if constexpr (Coefficients == 6)
        if (weight_gradient) weight_gradient[x] = volume * rest;
    }
    return is_own ? volume_ * energy : 0.0;
  }

  /// Of one row, from its coefficients' sums along z and y.
  template <std::size_t Coefficients>
  void give_gradient(const Scene& scene, int row, int plane, const double* sums, Work& work) const {
    const auto width = static_cast<std::size_t>(size_[0]);
    const T middle_f = scene.middle_fixed, middle_w = scene.middle_warped;
    for (std::size_t k = 0; k < Coefficients; ++k) sum_along_x(sums + k * stride_, work, k);
    const T* s = work.summed.data();
    const std::size_t first = first_of(row, plane);
    const T *fixed = scene.fixed + first, *warped = scene.warped + first;
    T* gradient = scene.gradient + first;
    if (Coefficients == 3 && !scene.weights) {
#pragma omp simd
      for (std::size_t x = 0; x < width; ++x)
        gradient[x] = (warped[x] - middle_w) * s[stride_ + x] + s[2 * stride_ + x] - (fixed[x] - middle_f) * s[x];
      return;
    }
    const T* weights = weights_from(scene, first);
    for (std::size_t x = 0; x < width; ++x) {
      const T weight = weights[x], f = fixed[x] - middle_f, w = warped[x] - middle_w;
      gradient[x] = weight == 0 ? T(0) : -weight * (f * s[x] - w * s[stride_ + x] - s[2 * stride_ + x]);
      if constexpr (Coefficients == 6)
        scene.weight_gradient[first + x] -= f * w * s[x] - T(0.5) * f * f * s[3 * stride_ + x] -
                                            T(0.5) * w * w * s[stride_ + x] + f * s[4 * stride_ + x] -
                                            w * s[2 * stride_ + x] + s[5 * stride_ + x];
    }
  }

  /// Of the row that begins there.
  const T* weights_from(const Scene& scene, std::size_t first) const {
    return scene.weights ? scene.weights + first : ones_.data();
  }
  std::size_t first_of(int row, int plane) const {
    return (static_cast<std::size_t>(plane) * static_cast<std::size_t>(size_[1]) + static_cast<std::size_t>(row)) *
           static_cast<std::size_t>(size_[0]);
  }
  /// Samples of a window along an axis, cut at the border.
  int window_count(int axis, int at) const {
    return std::min(size_[axis] - 1, at + radius_[axis]) - std::max(0, at - radius_[axis]) + 1;
  }

  std::array<int, 3> size_{1, 1, 1}, radius_{};  ///< along x, rows, planes
  std::size_t sites_, stride_;                   ///< of the lattice; between quantities of a row
  double volume_, floor2_;
  std::vector<T> inverse_widths_;  ///< 1 / window_count along x
  std::vector<T> ones_;            ///< a row of weights where none are given
  std::vector<Tile> tiles_;
  std::vector<Work> work_;  ///< by thread
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
