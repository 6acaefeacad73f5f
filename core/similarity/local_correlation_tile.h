#pragma once

#include <algorithm>
#include <array>
#include <cstddef>

#include "core/similarity/arriving_window.h"
#include "core/similarity/row_window.h"
#include "core/support/line_vector.h"
#include "core/support/registers.h"

namespace saltus {

/// What local_correlation.cpp works out, for one tile of the lattice; see there for the sums and coefficients.
struct CorrelationShape {
  std::array<int, 3> size, radius;  ///< along x, rows, planes
  double volume, floor2;            ///< of a site; the floor squared

  std::size_t window(int axis) const { return static_cast<std::size_t>(2 * radius[axis] + 1); }  ///< samples along it
  /// The same, cut at the border.
  int window_count(int axis, int at) const {
    return std::min(size[axis] - 1, at + radius[axis]) - std::max(0, at - radius[axis]) + 1;
  }
};

template <class T>
struct CorrelationScene {
  const T *fixed, *warped, *weights;
  T *gradient, *weight_gradient;
  T middle_fixed, middle_warped;
};

struct SiteRange {
  int begin = 0, end = 0;
  bool holds(int i) const { return begin <= i && i < end; }
  SiteRange grown(int by, int size) const { return {std::max(0, begin - by), std::min(size, end + by)}; }
  int count() const { return end - begin; }
};

struct CorrelationTile {
  SiteRange columns, rows, planes;
};

/// What a thread keeps of the tile it is at. All that is kept of a register of a row lies together, so that a row is
/// one stream: rows or planes of a window, and in each the quantities.
template <class T>
struct CorrelationWork {
  LineVector<T> images;               ///< both and the weights, of the planes of a window; 0 beyond the lattice
  LineVector<T> common;               ///< sums of products over the planes that two windows have in common
  LineVector<T> product_rows;         ///< see ArrivingWindow
  LineVector<T> coefficient_rows;     ///< the same of coefficients
  LineVector<T> coefficient_planes;   ///< the same of their sums along y
  LineVector<T> products, gradients;  ///< a row to be summed along x, quantity after quantity, between margins
  LineVector<T> summed;               ///< along x
  LineVector<T> shares, floors, own;  ///< by column
};

/// `Sums`: f, w, f^2, w^2, f w and, with weights, the weight. `Coefficients`: 3, or 6 with the gradient of the weights.
/// `Along`: the radius of windows along x; 0 when rows are summed beforehand, or need not be. `Across`: their radius
/// along y and z; -1 when only the program that runs knows it.
template <std::size_t Sums, std::size_t Coefficients, int Along, int Across, class T>
class CorrelationSweep {
 public:
  CorrelationSweep(const CorrelationShape& shape, const CorrelationScene<T>& scene, const CorrelationTile& tile,
                   CorrelationWork<T>& work)
      : shape_(shape), scene_(scene), tile_(tile), work_(work) {
    // With what the windows of its columns hold; its own begin with a register.
    const int radius = shape.radius[0];
    first_column_ = std::max(0, tile.columns.begin - static_cast<int>(whole(2 * radius)));
    const int end = std::min(shape.size[0], tile.columns.end + 2 * radius);
    width_ = static_cast<std::size_t>(end - first_column_);
    count_ = whole(end - first_column_);
    margin_ = std::max(kLanes, whole(radius));
    padded_ = count_ + 2 * margin_;
    own_begin_ = static_cast<std::size_t>(tile.columns.begin - first_column_);
    own_end_ = own_begin_ + static_cast<std::size_t>(tile.columns.count());
    rows_ = tile.rows.grown(2 * shape.radius[1], shape.size[1]);
    set_up_work();
  }

  /// Writes the tile's gradients; its energy.
  double run() {
    const int ry = radius(1), rz = radius(2);
    const SiteRange windows = tile_.rows.grown(ry, shape_.size[1]), centres = tile_.planes.grown(rz, shape_.size[2]);
    for (int plane = centres.begin - rz; plane < centres.begin + rz; ++plane)
      for (int row = rows_.begin; row < rows_.end; ++row) take_row(row, plane);
    for (int centre = centres.begin; centre < tile_.planes.end + rz; ++centre) {
      std::fill(work_.product_rows.begin(), work_.product_rows.end(), T(0));
      std::fill(work_.coefficient_rows.begin(), work_.coefficient_rows.end(), T(0));
      const bool is_first = (centre - centres.begin) % 2 == 0;
      for (int row = rows_.begin; row < tile_.rows.end + 2 * ry; ++row) {
        const int at = row - ry, own = row - 2 * ry;
        if (centres.holds(centre)) {
          const Window arriving(ry, row);
          if (rows_.holds(row)) {
            take_row(row, centre + rz);
            is_first ? sum_products<true>(row, centre + rz, arriving) : sum_products<false>(row, centre + rz, arriving);
          } else {
            no_products(arriving);
          }
        }
        if (at >= windows.begin) {
          const bool is_own_row = tile_.rows.holds(own);
          const Onward onward{{ry, at}, {rz, centre}, is_own_row, is_own_row ? coefficient_planes(own) : nullptr};
          if (centres.holds(centre) && windows.holds(at))
            find_coefficients(at, centre, onward);
          else
            no_coefficients(onward);
        }
        if (tile_.rows.holds(own) && tile_.planes.holds(centre - rz)) find_gradient(own, centre - rz);
      }
    }
    double energy = 0;
    for (double part : energy_) energy += part;
    return shape_.volume * energy;
  }

 private:
  using Lanes = Register<T>;
  using Window = ArrivingWindow<Across, T>;
  static constexpr std::size_t kLanes = kRegisterLanes<T>, kChannels = Sums - 3;

  static std::size_t whole(int columns) { return (static_cast<std::size_t>(columns) + kLanes - 1) / kLanes * kLanes; }
  int radius(int axis) const { return Across < 0 ? shape_.radius[axis] : Across; }
  std::size_t planes() const { return static_cast<std::size_t>(2 * radius(2) + 1); }
  /// Of a plane among those of a window.
  std::size_t place(int plane) const {
    const int count = 2 * radius(2) + 1;
    return static_cast<std::size_t>((plane + count) % count);
  }
  T* images(int row) const {
    return work_.images.data() + static_cast<std::size_t>(row - rows_.begin) * count_ * planes() * kChannels;
  }
  T* coefficient_planes(int row) const {
    return work_.coefficient_planes.data() +
           static_cast<std::size_t>(row - tile_.rows.begin) * count_ / kLanes * Window::state(radius(2), Coefficients);
  }
  std::size_t site(std::size_t column, int row, int plane) const {
    return (static_cast<std::size_t>(plane) * static_cast<std::size_t>(shape_.size[1]) +
            static_cast<std::size_t>(row)) *
               static_cast<std::size_t>(shape_.size[0]) +
           static_cast<std::size_t>(first_column_) + column;
  }

  /// Has the row after this one, which begins there, brought near: rows are too short for the machine to foresee it.
  void foresee(const T* begin, int row) const {
    if (row + 1 >= shape_.size[1]) return;
    const T* next = begin + shape_.size[0];
    for (std::size_t x = 0; x < width_; x += 64 / sizeof(T)) __builtin_prefetch(next + x);
  }

  void set_up_work() {
    const std::size_t rows = static_cast<std::size_t>(rows_.count()), registers = count_ / kLanes;
    work_.images.resize(rows * count_ * planes() * kChannels);
    work_.common.resize(rows * count_ * Sums);
    work_.product_rows.resize(registers * Window::state(radius(1), Sums));
    work_.coefficient_rows.resize(registers * Window::state(radius(1), Coefficients));
    work_.coefficient_planes.assign(
        static_cast<std::size_t>(tile_.rows.count()) * registers * Window::state(radius(2), Coefficients), T(0));
    work_.products.assign(Sums * padded_, T(0));
    work_.gradients.assign(Coefficients * padded_, T(0));
    work_.summed.resize(std::max(Sums, Coefficients) * count_);
    // Beyond the lattice windows have no share in anything, and a variance that can be divided by.
    work_.shares.assign(count_, T(0));
    work_.floors.assign(count_, T(1));
    work_.own.assign(count_, T(0));
    for (std::size_t x = 0; x < width_; ++x) {
      work_.shares[x] = T(1) / static_cast<T>(shape_.window_count(0, first_column_ + static_cast<int>(x)));
      work_.floors[x] = static_cast<T>(shape_.floor2);
      if (own_begin_ <= x && x < own_end_) work_.own[x] = T(1);
    }
  }

  /// Takes a row of both images in, less their means, and of the weights; none beyond the lattice. What is hidden by a
  /// weight of 0 is not looked at: it may be NaN.
  void take_row(int row, int plane) {
    const std::size_t step = planes() * kChannels * kLanes;
    T* to = images(row) + place(plane) * kChannels * kLanes;
    if (plane < 0 || plane >= shape_.size[2]) {
      for (std::size_t x = 0; x < count_; x += kLanes, to += step) std::fill_n(to, kChannels * kLanes, T(0));
      return;
    }
    const std::size_t first = site(0, row, plane);
    const T *fixed = scene_.fixed + first, *warped = scene_.warped + first;
    foresee(fixed, row);
    foresee(warped, row);
    const T middle_f = scene_.middle_fixed, middle_w = scene_.middle_warped;
    T ones[kLanes];
    std::fill_n(ones, kLanes, T(1));
    const auto take = [&](std::size_t x, const auto& read) {
      const Lanes f = read(fixed + x, middle_f) - middle_f, w = read(warped + x, middle_w) - middle_w;
      if constexpr (Sums == 5) {
        store<T>(f, to);
        store<T>(w, to + kLanes);
      } else {
        const Lanes weight = read(scene_.weights ? scene_.weights + first + x : ones, T(0));
        store<T>(weight != 0 ? f : Lanes{}, to);
        store<T>(weight != 0 ? w : Lanes{}, to + kLanes);
        store<T>(weight, to + 2 * kLanes);
      }
      to += step;
    };
    std::size_t x = 0;
    for (; x + kLanes <= width_; x += kLanes) take(x, [](const T* from, T) { return load(from); });
    if (x < width_) take(x, [&](const T* from, T other) { return load_first(width_ - x, from, other); });
  }

  /// Adds the products of a register of a row.
  [[gnu::always_inline]] static void add_products(const T* images, Lanes (&sums)[Sums]) {
    const Lanes f = load(images), w = load(images + kLanes);
    if constexpr (Sums == 5) {
      sums[0] += f;
      sums[1] += w;
      sums[2] += f * f;
      sums[3] += w * w;
      sums[4] += f * w;
    } else {
      const Lanes weight = load(images + 2 * kLanes), wf = weight * f, ww = weight * w;
      sums[0] += wf;
      sums[1] += ww;
      sums[2] += wf * f;
      sums[3] += ww * w;
      sums[4] += wf * w;
      sums[5] += weight;
    }
  }

  /// Sums the products of a row along z, up to `plane`, which has just been taken in, and along y. Two windows have all
  /// planes in common but one each: the first one leaves what it found of those to the second.
  template <bool IsFirst>
  void sum_products(int row, int plane, const Window& arriving) {
    constexpr std::size_t slot = kChannels * kLanes;
    const std::size_t state = Window::state(radius(1), Sums), last = (planes() - 1) * slot;
    const std::size_t newest = place(plane) * slot, oldest = newest == last ? 0 : newest + slot;
    const T* from = images(row);
    T* common = work_.common.data() + static_cast<std::size_t>(row - rows_.begin) * count_ * Sums;
    T *rows = work_.product_rows.data(), *to = work_.products.data() + margin_;
    for (std::size_t x = 0; x < count_; x += kLanes, from += last + slot, common += Sums * kLanes, rows += state) {
      Lanes sums[Sums] = {};
      if constexpr (IsFirst) {
        for (std::size_t i = 1, at = oldest; i < planes(); ++i) {
          at = at == last ? 0 : at + slot;
          add_products(from + at, sums);
        }
#pragma GCC unroll 6
        for (std::size_t k = 0; k < Sums; ++k) store<T>(sums[k], common + k * kLanes);
        add_products(from + oldest, sums);
      } else {
#pragma GCC unroll 6
        for (std::size_t k = 0; k < Sums; ++k) sums[k] = load(common + k * kLanes);
        add_products(from + newest, sums);
      }
      arriving.arrive(rows, sums);
#pragma GCC unroll 6
      for (std::size_t k = 0; k < Sums; ++k) store<T>(sums[k], to + k * padded_ + x);
    }
  }

  /// The same of a row beyond the lattice.
  void no_products(const Window& arriving) {
    T *rows = work_.product_rows.data(), *to = work_.products.data() + margin_;
    for (std::size_t x = 0; x < count_; x += kLanes, rows += Window::state(radius(1), Sums)) {
      Lanes sums[Sums] = {};
      arriving.arrive(rows, sums);
#pragma GCC unroll 6
      for (std::size_t k = 0; k < Sums; ++k) store<T>(sums[k], to + k * padded_ + x);
    }
  }

  /// Where coefficients go: the row and the plane that arrive with them, whether the row that they complete is one of
  /// the tile's, and what is kept of its planes.
  struct Onward {
    Window row, plane;
    bool completes_own;
    T* planes;
  };
  /// Of one register.
  [[gnu::always_inline]] void hand_on(std::size_t x, Lanes (&coefficients)[Coefficients], const Onward& onward) {
    const std::size_t at = x / kLanes;
    onward.row.arrive(work_.coefficient_rows.data() + at * Window::state(radius(1), Coefficients), coefficients);
    if (!onward.completes_own) return;
    onward.plane.arrive(onward.planes + at * Window::state(radius(2), Coefficients), coefficients);
    T* to = work_.gradients.data() + margin_ + x;
#pragma GCC unroll 6
    for (std::size_t k = 0; k < Coefficients; ++k) store<T>(coefficients[k], to + k * padded_);
  }

  void no_coefficients(const Onward& onward) {
    for (std::size_t x = 0; x < count_; x += kLanes) {
      Lanes none[Coefficients] = {};
      hand_on(x, none, onward);
    }
  }

  /// Rows to be summed along x, from column `begin` on.
  template <std::size_t Quantities>
  [[gnu::always_inline]] RowWindow<Along, Quantities, T> along_rows(T* rows, std::size_t begin) {
    if (Along > 0 || shape_.radius[0] == 0) return {rows + margin_, padded_, begin};
    for (std::size_t k = 0; k < Quantities; ++k) {
      T* row = rows + k * padded_;
      sum_along_row(count_, shape_.radius[0], row + margin_ - shape_.radius[0], work_.summed.data() + k * count_);
      std::fill_n(row, margin_, T(0));
      std::fill_n(row + margin_ + count_, margin_, T(0));
    }
    return {work_.summed.data(), count_, begin};
  }

  /// Of one row of windows. Without weights a window's are counted.
  void find_coefficients(int row, int plane, const Onward& onward) {
    const T volume = static_cast<T>(shape_.volume);
    const T across = T(1) / static_cast<T>(shape_.window_count(1, row) * shape_.window_count(2, plane));
    const T *shares = work_.shares.data(), *floors = work_.floors.data(), *own = work_.own.data();
    const T* weights = images(row) + (place(plane) * kChannels + 2) * kLanes;
    const bool is_own = tile_.rows.holds(row) && tile_.planes.holds(plane);
    auto windows = along_rows<Sums>(work_.products.data(), 0);
    Lanes energy = {};
    for (std::size_t x = 0; x < count_; x += kLanes) {
      Lanes s[Sums], k[Coefficients], weight, share, seen;
      windows.next(s);
      if constexpr (Sums == 5) {
        share = across * load(shares + x);
      } else {
        weight = load(weights + x * planes() * kChannels);
        const auto sees = Coefficients == 6 ? s[5] > T(1e-6) : (s[5] > T(1e-6)) & (weight != 0);  // else c is 0
        share = sees ? 1 / s[5] : Lanes{};
        seen = sees ? Lanes{} + 1 : Lanes{};
      }
      const Lanes floor = load(floors + x);
      const Lanes mean_f = s[0] * share, mean_w = s[1] * share;
      const Lanes e_f = s[2] * share - mean_f * mean_f, e_w = s[3] * share - mean_w * mean_w;
      const Lanes v_f = e_f > 0 ? e_f : Lanes{}, v_w = e_w > 0 ? e_w : Lanes{};
      const Lanes var_f = v_f + floor, var_w = v_w + floor, cov = s[4] * share - mean_f * mean_w;
      // The root does not wait for the quotient.
      const Lanes var2 = var_f * var_w, q2 = 1 / var2, q = q2 * square_root<T>(var2), c = cov * q;
      Lanes factor = volume * share;
      if constexpr (Sums == 6) factor *= weight;
      const Lanes a = factor * q, b = factor * c * (q2 * var_f);
      k[0] = a;
      k[1] = b;
      k[2] = a * mean_f - b * mean_w;
      if constexpr (Coefficients == 6) {
        // dc/dweight(y) = [ q ((f-mf)(w-mw) - cov) - c/2 ((f-mf)^2 - v_f)/var_f - c/2 ((w-mw)^2 - v_w)/var_w ] / S_w
        const Lanes d = factor * c * (q2 * var_w);
        k[3] = d;
        k[4] = d * mean_f - a * mean_w;
        k[5] = a * (mean_f * mean_w - cov) - T(0.5) * (d * (mean_f * mean_f - v_f) + b * (mean_w * mean_w - v_w));
      }
      hand_on(x, k, onward);
      if constexpr (Sums == 5) {
        energy += load(own + x) * (1 - c);
      } else {
        const Lanes rest = 1 - seen * c;
        energy += load(own + x) * weight * rest;
        if constexpr (Coefficients == 6)
          if (is_own && own_begin_ <= x && x < own_end_)
            store_first<T>(own_end_ - x, volume * rest, scene_.weight_gradient + site(x, row, plane));
      }
    }
    if (is_own)  // a row's in T, then in double
      for (std::size_t lane = 0; lane < kLanes; ++lane) energy_[lane] += double(energy[lane]);
  }

  /// Of one row, from the sums of its coefficients along y and z.
  void find_gradient(int row, int plane) {
    const std::size_t first = site(0, row, plane), step = planes() * kChannels;
    foresee(scene_.gradient + first, row);
    const T* own = images(row) + place(plane) * kChannels * kLanes;
    auto windows = along_rows<Coefficients>(work_.gradients.data(), own_begin_);
    const auto find = [&](std::size_t x, const auto& read, const auto& write) {
      Lanes s[Coefficients];
      windows.next(s);
      Lanes f = load(own + x * step), w = load(own + x * step + kLanes);
      if constexpr (Coefficients == 6) {  // also of what is hidden
        f = read(scene_.fixed + first + x) - scene_.middle_fixed;
        w = read(scene_.warped + first + x) - scene_.middle_warped;
      }
      Lanes slope = w * s[1] + s[2] - f * s[0];
      if constexpr (Sums == 6) {
        const Lanes weight = load(own + x * step + 2 * kLanes);
        slope = weight == 0 ? Lanes{} : weight * slope;
      }
      write(slope, scene_.gradient + first + x);
      if constexpr (Coefficients == 6) {
        T* weight_gradient = scene_.weight_gradient + first + x;
        const Lanes terms = w * (s[2] - f * s[0] + T(0.5) * w * s[1]) + f * (T(0.5) * f * s[3] - s[4]) - s[5];
        write(read(weight_gradient) + terms, weight_gradient);
      }
    };
    std::size_t x = own_begin_;
    for (; x + kLanes <= own_end_; x += kLanes)
      find(
          x, [](const T* from) { return load(from); }, [](const Lanes& values, T* to) { store<T>(values, to); });
    const std::size_t left = own_end_ - x;
    if (left > 0)
      find(
          x, [&](const T* from) { return load_first(left, from, T(0)); },
          [&](const Lanes& values, T* to) { store_first<T>(left, values, to); });
  }

  const CorrelationShape& shape_;
  const CorrelationScene<T> scene_;
  const CorrelationTile tile_;
  CorrelationWork<T>& work_;
  int first_column_;
  /// Columns from `first_column_` on: of the lattice; in whole registers; with margins; the tile's own.
  std::size_t width_, count_, margin_, padded_, own_begin_, own_end_;
  SiteRange rows_;
  std::array<double, kLanes> energy_{};
};

}  // namespace saltus
