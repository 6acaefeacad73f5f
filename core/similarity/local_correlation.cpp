#include "core/similarity/row_window.h"
#include "core/similarity/similarity.h"
#include "core/support/line_vector.h"
#include "core/support/registers.h"

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
/// Nothing of this sees a constant that is taken off an image; both lose their mean first, because sums are made in T
/// and a variance small against the mean would be lost in them.
///
/// One sweep along the last axis ("planes") does it all, so that memory sees both images and the gradient and nothing
/// else. For plane c of window centres each row goes through the whole chain: its products are summed along z, over
/// planes c - r to c + r; those of 2 r + 1 rows along y, these along x, and that gives the coefficients of the row r
/// before; the coefficients of 2 r + 1 rows are summed along y and wait; those of 2 r + 1 planes are summed along z and
/// x, and end as the gradient of plane c - r. The lattice is swept in tiles, bands of rows that are as high as the
/// cache allows; a tile works out what its neighbours' windows need of it for itself.
///
/// Every sum is made anew from what is in it. A window that moves on, taking in a row and letting one go, needs fewer
/// operations, but in double, or what had been in it would leave a trace, and writes what it carries: for windows of 5
/// samples that took 1.7 times as long, for windows of 9 the same, for windows of 17 two thirds.
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
    const auto rounded_up = [](int count) { return (static_cast<std::size_t>(count) + 15) / 16 * 16; };
    stride_ = rounded_up(size_[0]);
    margin_ = rounded_up(radius_[0]);
    padded_stride_ = stride_ + 2 * margin_;
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
  /// What a thread keeps of the tile it is at. Rows of one quantity after the other, `stride_` apart. As many rows, and
  /// planes, as a window holds: the place of one is its number modulo that, and those beyond the lattice are 0.
  struct Work {
    LineVector<T> image_rows;          ///< of both images and the weights: the planes of one row, then the next row
    LineVector<T> product_rows;        ///< summed along z
    LineVector<T> coefficient_rows;    ///< of window centres
    LineVector<T> coefficient_planes;  ///< summed along y: the planes of one row, then the next row
    LineVector<T> padded, summed;      ///< for the sums along x
  };

  void make_tiles() {
    // Rows that the cache holds: those of both images go beyond a tile by two radii on both sides.
    const std::size_t images = 2 * sizeof(T) * static_cast<std::size_t>(window(2));
    const std::size_t coefficients = 3 * sizeof(T) * static_cast<std::size_t>(window(2));
    const long rows = static_cast<long>(kCacheBytes / stride_) - 4 * radius_[1] * static_cast<long>(images);
    const long fit = rows / static_cast<long>(images + coefficients);
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
    const Range centres = tile.planes.grown(rz, size_[2]);
    constexpr std::size_t channels = Sums - 3;
    const std::size_t product_row = Sums * stride_, coefficient_row = Coefficients * stride_;
    const auto planes = static_cast<std::size_t>(window(2)), row_count = static_cast<std::size_t>(rows.count());
    work.image_rows.assign(row_count * planes * channels * stride_, T(0));
    work.product_rows.resize(static_cast<std::size_t>(window(1)) * product_row);
    work.coefficient_rows.resize(static_cast<std::size_t>(window(1)) * coefficient_row);
    work.coefficient_planes.assign(static_cast<std::size_t>(tile.rows.count()) * planes * coefficient_row, T(0));
    work.padded.resize(std::max(Sums, Coefficients) * padded_stride_);
    work.summed.resize(std::max(Sums, Coefficients) * stride_);
    const auto images = [&](int row) {
      return work.image_rows.data() + static_cast<std::size_t>(row - rows.begin) * planes * channels * stride_;
    };
    for (int plane = centres.begin - rz; plane < centres.begin + rz; ++plane)
      for (int row = rows.begin; row < rows.end; ++row)
        take_row<channels>(scene, row, plane, images(row) + place(plane, 2) * channels * stride_);
    double energy = 0;
    for (int centre = centres.begin; centre < tile.planes.end + rz; ++centre) {
      std::fill(work.product_rows.begin(), work.product_rows.end(), T(0));
      std::fill(work.coefficient_rows.begin(), work.coefficient_rows.end(), T(0));
      for (int row = rows.begin; row < tile.rows.end + 2 * ry; ++row) {
        const int at = row - ry, own = row - 2 * ry;
        if (centres.holds(centre)) {
          T* entering = work.product_rows.data() + place(row, 1) * product_row;
          if (rows.holds(row)) {
            take_row<channels>(scene, row, centre + rz, images(row) + place(centre + rz, 2) * channels * stride_);
            sum_products<Sums>(images(row), entering);
          } else {
            std::fill_n(entering, product_row, T(0));
          }
          T* coefficients = work.coefficient_rows.data() + place(at, 1) * coefficient_row;
          if (windows.holds(at)) {
            sum_windows(Sums, window(1), work.product_rows.data(), work);
            energy += coefficients_of<Sums, Coefficients>(
                scene, at, centre, tile.rows.holds(at) && tile.planes.holds(centre), work.summed.data(), coefficients);
          } else if (at >= 0) {
            std::fill_n(coefficients, coefficient_row, T(0));
          }
        }
        if (!tile.rows.holds(own)) continue;
        T* own_row =
            work.coefficient_planes.data() + static_cast<std::size_t>(own - tile.rows.begin) * planes * coefficient_row;
        T* entering = own_row + place(centre, 2) * coefficient_row;
        if (centres.holds(centre))
          sum_rows(window(1), coefficient_row, work.coefficient_rows.data(), coefficient_row, entering);
        else
          std::fill_n(entering, coefficient_row, T(0));
        if (!tile.planes.holds(centre - rz)) continue;
        sum_windows(Coefficients, window(2), own_row, work);
        give_gradient<Coefficients>(scene, own, centre - rz, work.summed.data());
      }
    }
    return energy;
  }

  /// Window sums of so many quantities: over `rows` that hold them one after the other, and along x.
  void sum_windows(std::size_t quantities, int rows, const T* first, Work& work) const {
    const auto width = static_cast<std::size_t>(size_[0]), radius = static_cast<std::size_t>(radius_[0]);
    // All along one axis, then all along the other: what has just been stored is not to be had between two registers.
    for (std::size_t k = 0; k < quantities; ++k) {
      T* padded = work.padded.data() + k * padded_stride_;
      std::fill_n(padded, margin_, T(0));
      sum_rows(rows, quantities * stride_, first + k * stride_, stride_, padded + margin_);
      std::fill_n(padded + margin_ + stride_, margin_, T(0));
    }
    for (std::size_t k = 0; k < quantities; ++k)
      sum_along_row(width, radius_[0], work.padded.data() + k * padded_stride_ + margin_ - radius,
                    work.summed.data() + k * stride_);
  }

  /// Takes a row of both images in, less their means, and of the weights; none beyond the lattice. What is hidden by a
  /// weight of 0 is not looked at: it may be NaN.
  template <std::size_t Channels>
  void take_row(const Scene& scene, int row, int plane, T* to) const {
    if (plane < 0 || plane >= size_[2]) return void(std::fill_n(to, Channels * stride_, T(0)));
    const std::size_t first = first_of(row, plane), width = static_cast<std::size_t>(size_[0]);
    const T *fixed = scene.fixed + first, *warped = scene.warped + first, *weights = weights_from(scene, first);
    const T middle_f = scene.middle_fixed, middle_w = scene.middle_warped;
    T *f = to, *w = to + stride_, *weight = to + 2 * stride_;
    if (row + 1 < size_[1])  // rows are too short for the machine to foresee the next one
      for (std::size_t x = width; x < 2 * width; x += 64 / sizeof(T)) {
        __builtin_prefetch(fixed + x);
        __builtin_prefetch(warped + x);
      }
    if constexpr (Channels == 2) {
#pragma omp simd
      for (std::size_t x = 0; x < width; ++x) f[x] = fixed[x] - middle_f, w[x] = warped[x] - middle_w;
    } else {
#pragma omp simd
      for (std::size_t x = 0; x < width; ++x) {
        f[x] = weights[x] != 0 ? fixed[x] - middle_f : T(0);
        w[x] = weights[x] != 0 ? warped[x] - middle_w : T(0);
        weight[x] = weights[x];
      }
    }
  }

  /// Products of the rows that lie above each other in a window, summed.
  template <std::size_t Sums>
  void sum_products(const T* images, T* to) const {
    constexpr std::size_t channels = Sums - 3;
    for (std::size_t x = 0; x < stride_; x += kRegisterLanes<T>) {
      Register<T> sums[Sums] = {};
      const T* at = images + x;
      for (int k = 0; k < window(2); ++k, at += channels * stride_) {
        const Register<T> f = load(at), w = load(at + stride_);
        if constexpr (channels == 2) {
          sums[0] += f;
          sums[1] += w;
          sums[2] += f * f;
          sums[3] += w * w;
          sums[4] += f * w;
        } else {
          const Register<T> weight = load(at + 2 * stride_), wf = weight * f, ww = weight * w;
          sums[0] += wf;
          sums[1] += ww;
          sums[2] += wf * f;
          sums[3] += ww * w;
          sums[4] += wf * w;
          sums[5] += weight;
        }
      }
      for (std::size_t k = 0; k < Sums; ++k) store(sums[k], to + k * stride_ + x);
    }
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
    T *k_f = to, *k_w = to + stride_, *k_1 = to + 2 * stride_;
    T *k_ff = Coefficients == 6 ? to + 3 * stride_ : nullptr, *m_f = Coefficients == 6 ? to + 4 * stride_ : nullptr,
      *m_1 = Coefficients == 6 ? to + 5 * stride_ : nullptr;
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

  /// Of one row, from the window sums of its coefficients.
  template <std::size_t Coefficients>
  void give_gradient(const Scene& scene, int row, int plane, const T* s) const {
    const auto width = static_cast<std::size_t>(size_[0]);
    const T middle_f = scene.middle_fixed, middle_w = scene.middle_warped;
    const std::size_t first = first_of(row, plane);
    const T *fixed = scene.fixed + first, *warped = scene.warped + first;
    T* gradient = scene.gradient + first;
    if (Coefficients == 3 && !scene.weights) {
#pragma omp simd
      for (std::size_t x = 0; x < width; ++x)
        gradient[x] = (warped[x] - middle_w) * s[stride_ + x] + s[2 * stride_ + x] - (fixed[x] - middle_f) * s[x];
      return;
    }
    const T *weights = weights_from(scene, first), *k_f = s, *k_w = s + stride_, *k_1 = s + 2 * stride_;
    const T *k_ff = Coefficients == 6 ? s + 3 * stride_ : nullptr, *m_f = Coefficients == 6 ? s + 4 * stride_ : nullptr,
            *m_1 = Coefficients == 6 ? s + 5 * stride_ : nullptr;
    T* weight_gradient = Coefficients == 6 ? scene.weight_gradient + first : nullptr;
#pragma omp simd
    for (std::size_t x = 0; x < width; ++x) {
      const T weight = weights[x], f = fixed[x] - middle_f, w = warped[x] - middle_w;
      const T along = w * k_w[x] + k_1[x] - f * k_f[x];
      gradient[x] = weight == 0 ? T(0) : weight * along;
      if constexpr (Coefficients == 6)
        weight_gradient[x] +=
            w * (k_1[x] - f * k_f[x] + T(0.5) * w * k_w[x]) + f * (T(0.5) * f * k_ff[x] - m_f[x]) - m_1[x];
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
  int window(int axis) const { return 2 * radius_[axis] + 1; }  ///< samples along an axis
  std::size_t place(int i, int axis) const { return static_cast<std::size_t>((i + window(axis)) % window(axis)); }
  /// The same, cut at the border.
  int window_count(int axis, int at) const {
    return std::min(size_[axis] - 1, at + radius_[axis]) - std::max(0, at - radius_[axis]) + 1;
  }

  std::array<int, 3> size_{1, 1, 1}, radius_{};  ///< along x, rows, planes
  std::size_t sites_, stride_;                   ///< of the lattice; between quantities of a row
  std::size_t margin_, padded_stride_;           ///< zeros on either side of a row; between rows with those
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
