#pragma once

#include <algorithm>
#include <array>
#include <cstddef>

#include "core/similarity/pair_window.h"
#include "core/similarity/row_window.h"
#include "core/similarity/site_range.h"
#include "core/similarity/window_correlation.h"
#include "core/support/line_vector.h"
#include "core/support/registers.h"

namespace saltus {

/// What local_correlation.cpp works out, for one tile of the lattice; see there, and WindowCorrelation for sums and
/// coefficients.
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

struct CorrelationTile {
  SiteRange columns, rows, planes;
};

/// What a thread keeps of the tile it is at. All that is kept of a register of a row lies together, so that a row is
/// one stream: rows or planes of a window, and in each the quantities.
template <class T>
struct CorrelationWork {
  LineVector<T> images;                  ///< both and the weights, of the planes of a window; 0 beyond the lattice
  LineVector<T> common;                  ///< sums of products over the planes that two windows have in common
  LineVector<T> product_rows;            ///< see PairWindow
  LineVector<T> coefficient_rows;        ///< the same of coefficients
  LineVector<T> coefficient_planes;      ///< the same of their sums along x and y
  LineVector<T> first_planes;            ///< such sums, which wait for the second plane of a pair
  LineVector<T> products, coefficients;  ///< rows to be summed along x, between margins
  LineVector<T> summed;                  ///< such rows along x
  LineVector<T> coefficient_sums;        ///< coefficients along x, then along y
  LineVector<T> shares, floors, own;     ///< by column
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
    own_count_ = whole(tile.columns.count());
    rows_ = tile.rows.grown(2 * shape.radius[1], shape.size[1]);
    set_up_work();
  }

  /// Writes the tile's gradients; its energy.
  double run() {
    const int ry = radius(1), rz = radius(2), step = rows_at_once();
    const SiteRange windows = tile_.rows.grown(ry, shape_.size[1]), centres = tile_.planes.grown(rz, shape_.size[2]);
    for (int plane = centres.begin - rz; plane < centres.begin + rz; ++plane)
      for (int row = rows_.begin; row < rows_.end; ++row) take_row(row, plane);
    const int planes = tile_.planes.end + rz - centres.begin;
    for (int i = 0; i < planes + planes % 2; ++i) {
      const int centre = centres.begin + i;
      const bool is_first = i % 2 == 0, has_windows = centres.holds(centre);
      std::fill(work_.product_rows.begin(), work_.product_rows.end(), T(0));
      std::fill(work_.coefficient_rows.begin(), work_.coefficient_rows.end(), T(0));
      const Window planes_arriving(rz, i / 2);
      for (int row = rows_.begin; row < tile_.rows.end + 2 * ry; row += step) {
        const int at = row - ry, own = row - 2 * ry;
        const Window arriving(ry, (row - rows_.begin) / 2);
        if (has_windows) {
          for (int j = 0; j < step; ++j)
            if (rows_.holds(row + j)) take_row(row + j, centre + rz);
          sum_products(row, centre + rz, is_first, arriving);
        }
        if (at + step <= windows.begin) continue;
        for (int j = 0; j < step; ++j)
          if (has_windows && windows.holds(at + j))
            find_coefficients(at + j, centre, j, coming(row + step + j, centre + rz));
          else
            no_coefficients(j);
        sum_coefficients(own, is_first, arriving);
        for (int j = 0; j < step; ++j)
          if (!is_first && tile_.rows.holds(own + j)) find_gradients(own + j, centre - rz, j, planes_arriving);
      }
    }
    double energy = 0;
    for (double part : energy_) energy += part;
    return shape_.volume * energy;
  }

 private:
  // What goes along rows is not inlined: apart, each loop has the registers for all its pointers.
  using Lanes = Register<T>;
  using Window = PairWindow<Across, T>;
  static constexpr std::size_t kLanes = kRegisterLanes<T>, kChannels = Sums - 3;
  /// Two windows that follow each other along z have all planes in common but one each. What they share is kept where
  /// windows are wide; of few planes the images are read again in the time that takes.
  static constexpr bool kKeepsCommon = Along == 0;

  static std::size_t whole(int columns) { return (static_cast<std::size_t>(columns) + kLanes - 1) / kLanes * kLanes; }
  int radius(int axis) const { return Across < 0 ? shape_.radius[axis] : Across; }
  /// That are kept of the images: those of two windows.
  std::size_t planes() const { return static_cast<std::size_t>(2 * radius(2) + 2); }
  /// Of a plane among those.
  std::size_t place(int plane) const {
    const int count = 2 * radius(2) + 2;
    return static_cast<std::size_t>((plane + count) % count);
  }
  int rows_at_once() const { return radius(1) == 0 ? 1 : 2; }
  /// Of a row among those that are kept; those beyond share one that is 0.
  std::size_t kept(int row) const { return static_cast<std::size_t>(std::min(row, rows_.end) - rows_.begin); }
  T* images(int row) const { return work_.images.data() + kept(row) * count_ * planes() * kChannels; }
  T* common(int row) const { return kKeepsCommon ? work_.common.data() + kept(row) * count_ * Sums : nullptr; }
  /// Of one of the tile's rows, its first register.
  T* coefficient_planes(int row) const {
    return work_.coefficient_planes.data() + static_cast<std::size_t>(row - tile_.rows.begin) * own_count_ / kLanes *
                                                 Window::state(radius(2), Coefficients);
  }
  T* first_plane(int row) const {
    return work_.first_planes.data() + static_cast<std::size_t>(row - tile_.rows.begin) * own_count_ * Coefficients;
  }
  T* products(int which) const { return work_.products.data() + static_cast<std::size_t>(which) * Sums * padded_; }
  T* coefficients(int which) const {
    return work_.coefficients.data() + static_cast<std::size_t>(which) * Coefficients * padded_;
  }
  T* coefficient_sums(int which) const {
    return work_.coefficient_sums.data() + static_cast<std::size_t>(which) * Coefficients * own_count_;
  }
  /// Where column x of a padded row of several quantities begins, and how far it is from there to the next quantity and
  /// to the next register: rows that are summed register after register are one stream.
  template <std::size_t Quantities>
  std::size_t padded_column(std::size_t x) const {
    return (margin_ + x) * (Along > 0 ? Quantities : 1);
  }
  std::size_t padded_stride() const { return Along > 0 ? kLanes : padded_; }
  template <std::size_t Quantities>
  static constexpr std::size_t kPaddedStep = Along > 0 ? Quantities* kLanes : kLanes;

  std::size_t site(std::size_t column, int row, int plane) const {
    return (static_cast<std::size_t>(plane) * static_cast<std::size_t>(shape_.size[1]) +
            static_cast<std::size_t>(row)) *
               static_cast<std::size_t>(shape_.size[0]) +
           static_cast<std::size_t>(first_column_) + column;
  }

  /// Where a row begins that is to be taken in soon: rows are too short for the machine to foresee them. Beyond the
  /// last one, the rows of the next plane.
  std::size_t coming(int row, int plane) const {
    if (row >= rows_.end) row += rows_.begin - rows_.end, ++plane;
    return site(0, std::min(row, rows_.end - 1), std::clamp(plane, 0, shape_.size[2] - 1));
  }
  /// How far it is to the row that comes next but `rows_at_once`.
  std::size_t next_row(int row) const {
    return row + rows_at_once() < shape_.size[1] ? static_cast<std::size_t>(rows_at_once() * shape_.size[0]) : 0;
  }

  void set_up_work() {
    const std::size_t rows = static_cast<std::size_t>(rows_.count()), registers = count_ / kLanes;
    const std::size_t own_rows = static_cast<std::size_t>(tile_.rows.count());
    work_.images.resize((rows + 1) * count_ * planes() * kChannels);
    std::fill_n(images(rows_.end), count_ * planes() * kChannels, T(0));
    if (kKeepsCommon) work_.common.resize((rows + 1) * count_ * Sums);
    work_.product_rows.resize(registers * Window::state(radius(1), Sums));
    work_.coefficient_rows.resize(own_count_ / kLanes * Window::state(radius(1), Coefficients));
    work_.coefficient_planes.assign(own_rows * own_count_ / kLanes * Window::state(radius(2), Coefficients), T(0));
    work_.first_planes.resize(own_rows * own_count_ * Coefficients);
    work_.products.assign(2 * Sums * padded_, T(0));
    work_.coefficients.assign(2 * Coefficients * padded_, T(0));
    work_.summed.resize(2 * std::max(Sums, Coefficients) * count_);
    work_.coefficient_sums.resize(2 * Coefficients * own_count_);
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
  [[gnu::noinline]] void take_row(int row, int plane) {
    const std::size_t step = planes() * kChannels * kLanes;
    T* to = images(row) + place(plane) * kChannels * kLanes;
    if (plane < 0 || plane >= shape_.size[2]) {
      for (std::size_t x = 0; x < count_; x += kLanes, to += step) std::fill_n(to, kChannels * kLanes, T(0));
      return;
    }
    const std::size_t first = site(0, row, plane);
    const T *fixed = scene_.fixed + first, *warped = scene_.warped + first;
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

  /// The products of a register of a row.
  [[gnu::always_inline]] static void find_products(const T* images, Lanes (&products)[Sums]) {
    const Lanes f = load(images), w = load(images + kLanes);
    Lanes wf = f, ww = w;
    if constexpr (Sums == 6) {
      products[5] = load(images + 2 * kLanes);
      wf *= products[5], ww *= products[5];
    }
    products[0] = wf;
    products[1] = ww;
    products[2] = wf * f;
    products[3] = ww * w;
    products[4] = wf * w;
  }
  [[gnu::always_inline]] static void add_products(const T* images, Lanes (&sums)[Sums]) {
    Lanes products[Sums];
    find_products(images, products);
#pragma GCC unroll 6
    for (std::size_t k = 0; k < Sums; ++k) sums[k] += products[k];
  }

  /// Sums the products of two rows along z, up to `plane`, which has just been taken in, and along y.
  [[gnu::noinline]] void sum_products(int row, int plane, bool is_first, const Window& arriving) {
    constexpr std::size_t slot = kChannels * kLanes;
    const std::size_t state = Window::state(radius(1), Sums), last = (planes() - 1) * slot, stride = padded_stride();
    const std::size_t oldest = place(plane - 2 * radius(2)) * slot, newest = place(plane) * slot, count = count_;
    std::array<std::size_t, static_cast<std::size_t>(Across < 0 ? 1 : 2 * Across + 1)> places{oldest};
    for (std::size_t i = 1; i < places.size(); ++i) places[i] = places[i - 1] == last ? 0 : places[i - 1] + slot;
    const auto add_following = [&](const T* from, std::size_t planes, Lanes(&sums)[Sums])
        __attribute__((always_inline)) {
      if constexpr (Across < 0) {
        for (std::size_t i = 0, at = oldest; i < planes; ++i) {
          at = at == last ? 0 : at + slot;
          add_products(from + at, sums);
        }
      } else {
#pragma GCC unroll 6
        for (std::size_t i = 1; i < places.size(); ++i) add_products(from + places[i], sums);
      }
    };
    const auto along_planes = [&](const T* from, T* common, Lanes(&sums)[Sums]) __attribute__((always_inline)) {
      if constexpr (!kKeepsCommon) {
        find_products(from + oldest, sums);
        add_following(from, planes() - 2, sums);
      } else if (is_first) {
#pragma GCC unroll 6
        for (std::size_t k = 0; k < Sums; ++k) sums[k] = Lanes{};
        add_following(from, planes() - 2, sums);
#pragma GCC unroll 6
        for (std::size_t k = 0; k < Sums; ++k) store<T>(sums[k], common + k * kLanes);
        add_products(from + oldest, sums);
      } else {
#pragma GCC unroll 6
        for (std::size_t k = 0; k < Sums; ++k) sums[k] = load(common + k * kLanes);
        add_products(from + newest, sums);
      }
    };
    const bool is_pair = rows_at_once() == 2;
    const T *from_a = images(row), *from_b = images(row + 1);
    T *common_a = common(row), *common_b = common(row + 1);
    T *rows = work_.product_rows.data(), *to_a = products(0) + padded_column<Sums>(0),
      *to_b = products(1) + padded_column<Sums>(0);
    for (std::size_t x = 0; x < count; x += kLanes) {
      Lanes a[Sums], b[Sums];
      along_planes(from_a, common_a, a);
      if (is_pair) {
        along_planes(from_b, common_b, b);
        arriving.arrive(rows, a, b);
#pragma GCC unroll 6
        for (std::size_t k = 0; k < Sums; ++k) store<T>(b[k], to_b + k * stride);
      }
#pragma GCC unroll 6
      for (std::size_t k = 0; k < Sums; ++k) store<T>(a[k], to_a + k * stride);
      from_a += last + slot, from_b += last + slot, rows += state;
      if constexpr (kKeepsCommon) common_a += Sums * kLanes, common_b += Sums * kLanes;
      to_a += kPaddedStep<Sums>, to_b += kPaddedStep<Sums>;
    }
  }

  void no_coefficients(int which) { std::fill_n(coefficients(which), Coefficients * padded_, T(0)); }

  /// The sums along x of a padded row, the `which`-th of two, from column `begin` on.
  template <std::size_t Quantities>
  [[gnu::always_inline]] RowWindow<Along, Quantities, T> along_row(T* row, int which, std::size_t begin) {
    if constexpr (Along > 0) return {row + padded_column<Quantities>(begin), kLanes, kPaddedStep<Quantities>};
    T* summed = work_.summed.data() + static_cast<std::size_t>(which) * Quantities * count_;
    for (std::size_t k = 0; k < Quantities; ++k, row += padded_) {
      sum_along_row(count_, shape_.radius[0], row + margin_ - shape_.radius[0], summed + k * count_);
      std::fill_n(row, margin_, T(0));
      std::fill_n(row + margin_ + count_, margin_, T(0));
    }
    return {summed + begin, count_, kLanes};
  }

  /// Of one row of windows, the first or second one of two. Without weights a window's are counted.
  [[gnu::noinline]] void find_coefficients(int row, int plane, int which, std::size_t coming) {
    const T volume = static_cast<T>(shape_.volume);
    const T across = T(1) / static_cast<T>(shape_.window_count(1, row) * shape_.window_count(2, plane));
    const T *shares = work_.shares.data(), *floors = work_.floors.data(), *own = work_.own.data();
    const T* weights = images(row) + (place(plane) * kChannels + 2) * kLanes;
    const bool is_own = tile_.rows.holds(row) && tile_.planes.holds(plane);
    const std::size_t count = count_;
    T* to = coefficients(which) + padded_column<Coefficients>(0);
    RowWindow<Along, Sums, T> windows = along_row<Sums>(products(which), which, 0);
    Lanes energy = {};
    const auto begin = [&](std::size_t x) __attribute__((always_inline)) {
      WindowCorrelation<T> window;
      Lanes s[Sums];
      windows.next(s);
      if constexpr (Sums == 5)
        window.find(s, across * load(shares + x), load(floors + x));
      else
        window.find_weighted(s, load(weights + x * planes() * kChannels), load(floors + x), Coefficients == 6);
      return window;
    };
    const T *coming_fixed = scene_.fixed + coming, *coming_warped = scene_.warped + coming;
    const auto finish = [&](std::size_t x, const WindowCorrelation<T>& window) __attribute__((always_inline)) {
      __builtin_prefetch(coming_fixed + x);
      __builtin_prefetch(coming_warped + x);
      Lanes factor = volume * window.share;
      if constexpr (Sums == 6) factor *= window.weight;
      Lanes k[Coefficients];
      window.find_coefficients(factor, k);
#pragma GCC unroll 6
      for (std::size_t i = 0; i < Coefficients; ++i) store<T>(k[i], to + i * padded_stride());
      to += kPaddedStep<Coefficients>;
      if constexpr (Sums == 5) {
        energy += load(own + x) * (1 - window.correlation());
      } else {
        const Lanes rest = 1 - window.seen * window.correlation();
        energy += load(own + x) * window.weight * rest;
        if constexpr (Coefficients == 6)
          if (is_own && own_begin_ <= x && x < own_end_)
            store_first<T>(own_end_ - x, volume * rest, scene_.weight_gradient + site(x, row, plane));
      }
    };
    for_windows<Coefficients == 6, T>(count, begin, finish);
    if (is_own)  // a row's in T, then in double
      for (std::size_t lane = 0; lane < kLanes; ++lane) energy_[lane] += double(energy[lane]);
  }

  /// Sums those of two rows along x and y, which completes the two from `own` on. In a first plane they wait for the
  /// second.
  [[gnu::noinline]] void sum_coefficients(int own, bool is_first, const Window& arriving) {
    const std::size_t state = Window::state(radius(1), Coefficients), count = own_count_;
    const bool is_pair = rows_at_once() == 2;
    RowWindow<Along, Coefficients, T> a = along_row<Coefficients>(coefficients(0), 0, own_begin_), b = a;
    if (is_pair) b = along_row<Coefficients>(coefficients(1), 1, own_begin_);
    T* rows = work_.coefficient_rows.data();
    T* to_a = is_first && tile_.rows.holds(own) ? first_plane(own) : coefficient_sums(0);
    T* to_b = is_first && tile_.rows.holds(own + 1) ? first_plane(own + 1) : coefficient_sums(1);
    for (std::size_t x = 0; x < count; x += kLanes) {
      Lanes first[Coefficients], second[Coefficients];
      a.next(first);
      if (is_pair) {
        b.next(second);
        arriving.arrive(rows, first, second);
#pragma GCC unroll 6
        for (std::size_t k = 0; k < Coefficients; ++k) store<T>(second[k], to_b + k * kLanes);
      }
#pragma GCC unroll 6
      for (std::size_t k = 0; k < Coefficients; ++k) store<T>(first[k], to_a + k * kLanes);
      to_a += Coefficients * kLanes, to_b += Coefficients * kLanes, rows += state;
    }
  }

  /// Of one row, the `which`-th of two, in `plane` and the one before, from the sums along x and y of its coefficients.
  [[gnu::noinline]] void find_gradients(int row, int plane, int which, const Window& arriving) {
    const std::size_t state = Window::state(radius(2), Coefficients), step = planes() * kChannels * kLanes;
    const std::size_t own = static_cast<std::size_t>(tile_.columns.count());
    const bool has_first = tile_.planes.holds(plane - 1), has_second = tile_.planes.holds(plane);
    const T *first = first_plane(row), *second = coefficient_sums(which);
    const T* image = images(row) + own_begin_ * planes() * kChannels;
    const T *image_a = image + place(plane - 1) * kChannels * kLanes,
            *image_b = image + place(plane) * kChannels * kLanes;
    T* kept = coefficient_planes(row);
    std::size_t at_a = has_first ? site(own_begin_, row, plane - 1) : 0,
                at_b = has_second ? site(own_begin_, row, plane) : 0;
    const std::size_t next = next_row(row);
    const auto find = [&](const auto& read, const auto& write) __attribute__((always_inline)) {
      Lanes a[Coefficients], b[Coefficients];
#pragma GCC unroll 6
      for (std::size_t k = 0; k < Coefficients; ++k) {
        a[k] = load(first + k * kLanes);
        b[k] = load(second + k * kLanes);
      }
      arriving.arrive(kept, a, b);
      __builtin_prefetch(scene_.gradient + at_a + next, 1);
      __builtin_prefetch(scene_.gradient + at_b + next, 1);
      if (has_first) find_gradient(a, image_a, at_a, read, write);
      if (has_second) find_gradient(b, image_b, at_b, read, write);
      first += Coefficients * kLanes, second += Coefficients * kLanes, kept += state;
      image_a += step, image_b += step, at_a += kLanes, at_b += kLanes;
    };
    std::size_t x = 0;
    for (; x + kLanes <= own; x += kLanes)
      find([](const T* from) { return load(from); }, [](const Lanes& values, T* to) { store<T>(values, to); });
    const std::size_t left = own - x;
    if (left > 0)
      find([&](const T* from) { return load_first(left, from, T(0)); },
           [&](const Lanes& values, T* to) { store_first<T>(left, values, to); });
  }

  /// Of a register, from the window sums `s` of its coefficients and what is kept of its images.
  template <class Read, class Write>
  [[gnu::always_inline]] void find_gradient(const Lanes (&s)[Coefficients], const T* images, std::size_t site,
                                            const Read& read, const Write& write) const {
    Lanes f = load(images), w = load(images + kLanes);
    if constexpr (Coefficients == 6) {  // also of what is hidden
      f = read(scene_.fixed + site) - scene_.middle_fixed;
      w = read(scene_.warped + site) - scene_.middle_warped;
    }
    Lanes slope = w * s[1] + s[2] - f * s[0];
    if constexpr (Sums == 6) {
      const Lanes weight = load(images + 2 * kLanes);
      slope = weight == 0 ? Lanes{} : weight * slope;
    }
    write(slope, scene_.gradient + site);
    if constexpr (Coefficients == 6) {
      T* weight_gradient = scene_.weight_gradient + site;
      const Lanes terms = w * (s[2] - f * s[0] + T(0.5) * w * s[1]) + f * (T(0.5) * f * s[3] - s[4]) - s[5];
      write(read(weight_gradient) + terms, weight_gradient);
    }
  }

  const CorrelationShape& shape_;
  const CorrelationScene<T> scene_;
  const CorrelationTile tile_;
  CorrelationWork<T>& work_;
  int first_column_;
  /// Columns from `first_column_` on: of the lattice; in whole registers; with margins; the tile's own, in registers.
  std::size_t width_, count_, margin_, padded_, own_begin_, own_end_, own_count_;
  SiteRange rows_;
  std::array<double, kLanes> energy_{};
};

}  // namespace saltus
