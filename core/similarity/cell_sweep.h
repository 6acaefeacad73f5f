#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdlib>

#include "core/similarity/rimmed_row_window.h"
#include "core/similarity/site_range.h"
#include "core/similarity/window_correlation.h"
#include "core/support/line_vector.h"
#include "core/support/registers.h"

namespace saltus {

/// What cell_correlation.cpp works out, for one tile of the lattice; see there, and WindowCorrelation for sums and
/// coefficients.

/// A window along one axis: so many cells on both sides of its middle cell.
struct CellWindow {
  int cell = 1;                                               ///< samples of a cell: 1 or 2
  int radius = 1;                                             ///< cells
  double rim() const { return cell == 2 ? kRimOfPairs : 1; }  ///< how much the outermost cells count
  /// Measured beside windows of 2 r + 1 samples around each, core/measurements.md, "Windows of lncc".
  static constexpr double kRimOfPairs = 0.25;
};

/// The window of half width `radius`, in samples r once rounded and at least 1: three cells of one sample where r is 1,
/// else (r + 1) / 2 (whole) cells of two samples on both sides. With its rim such a window of radius 2 is as wide
/// as 4.5 samples (by the variance of a place in it), one of radius 4 as 8.
inline CellWindow cell_window(double radius) {
  const int samples = std::max(1, static_cast<int>(std::lround(radius)));
  return samples == 1 ? CellWindow{1, 1} : CellWindow{2, (samples + 1) / 2};
}

/// How the lattice is cut into cells and what windows of these are, along x, rows and planes.
struct CellShape {
  std::array<int, 3> size;            ///< samples
  std::array<CellWindow, 3> windows;  ///< of radius 0 along an axis of one sample
  double volume = 1, floor2 = 0;      ///< of a sample; the floor squared

  int cell(int axis) const { return windows[static_cast<std::size_t>(axis)].cell; }
  int radius(int axis) const { return windows[static_cast<std::size_t>(axis)].radius; }
  int window(int axis) const { return 2 * radius(axis) + 1; }  ///< cells along it
  double rim(int axis) const { return windows[static_cast<std::size_t>(axis)].rim(); }
  int cells(int axis) const { return (size[static_cast<std::size_t>(axis)] + cell(axis) - 1) / cell(axis); }
  int samples_in_cell(int axis, int at) const {  ///< the last one may lack one
    return std::min(cell(axis), size[static_cast<std::size_t>(axis)] - at * cell(axis));
  }
  /// Of the window around a cell, as far as they count; it ends with the lattice.
  double samples_in_window(int axis, int at) const {
    double sum = samples_in_cell(axis, at);
    for (int by = 1; by <= radius(axis); ++by)
      for (int other : {at - by, at + by})
        if (0 <= other && other < cells(axis))
          sum += samples_in_cell(axis, other) * (by == radius(axis) ? rim(axis) : 1);
    return sum;
  }
};

template <class T>
struct CellScene {
  const T *fixed, *warped, *weights;
  T *gradient, *weight_gradient;
  T middle_fixed, middle_warped;
};

/// Cells that one sweep is for: whole rows of them.
struct CellTile {
  SiteRange rows, planes;
  int band = 0;  ///< of rows
};

/// What a thread keeps of the tile it is at. Rows of quantities are one stream: of each register of cells all
/// quantities, then the next register.
template <class T>
struct CellWork {
  LineVector<T> products;                      ///< of the cells of a plane
  LineVector<T> product_planes;                ///< summed along y, of the planes of a window
  LineVector<T> cell_weights;                  ///< of the same planes
  LineVector<T> coefficients;                  ///< of the windows of a plane
  LineVector<T> coefficient_planes;            ///< summed along x and y, of the planes of a window
  LineVector<T> rests;                         ///< 1 - c of the same planes
  LineVector<T> product_row, coefficient_row;  ///< to be summed along x, between margins of 0
  LineVector<T> apart, summed;                 ///< the same of one quantity, and its sums, where windows are wide
  LineVector<T> shares, floors, own;           ///< by cell of a row
};

/// `Sums`: f, w, f^2, w^2, f w and, with weights, the weight. `Coefficients`: 3, or 6 with the gradient of the weights.
/// `Cell`: samples of a cell along x. `Along`: the radius of windows along x; 0 when rows are summed beforehand, or
/// need not be.
template <std::size_t Sums, std::size_t Coefficients, int Cell, int Along, class T>
class CellSweep {
 public:
  CellSweep(const CellShape& shape, const CellScene<T>& scene, const CellTile& tile, CellWork<T>& work)
      : shape_(shape), scene_(scene), tile_(tile), work_(work) {
    registers_ = (static_cast<std::size_t>(shape.cells(0)) + kLanes - 1) / kLanes;
    margin_ = (static_cast<std::size_t>(shape.radius(0)) + kLanes - 1) / kLanes;
    window_rows_ = tile.rows.grown(shape.radius(1), shape.cells(1));
    product_rows_ = window_rows_.grown(shape.radius(1), shape.cells(1));
    windows_ = tile.planes.grown(shape.radius(2), shape.cells(2));
    products_ = windows_.grown(shape.radius(2), shape.cells(2));
    ones_.fill(T(1));
    set_up_work();
  }

  /// Writes the tile's gradients, and the energy of each of its planes of cells, the first of which is `energies[0]`.
  void run(double* energies) {
    energies_ = energies;
    const int radius = shape_.radius(2);
    for (int plane = products_.begin; plane < tile_.planes.end + 2 * radius; ++plane) {
      if (products_.holds(plane)) take_plane(plane);
      if (windows_.holds(plane - radius)) find_coefficients(plane - radius);
      if (tile_.planes.holds(plane - 2 * radius)) find_gradients(plane - 2 * radius);
    }
  }

 private:
  using Lanes = Register<T>;
  static constexpr std::size_t kLanes = kRegisterLanes<T>;
  static constexpr bool kIsWeighted = Sums == 6;
  template <std::size_t Quantities>
  using Window = RimmedRowWindow<Along, Quantities, T>;

  void set_up_work() {
    const auto planes = static_cast<std::size_t>(shape_.window(2));
    const auto rows = static_cast<std::size_t>(tile_.rows.count()),
               window_rows = static_cast<std::size_t>(window_rows_.count()),
               product_rows = static_cast<std::size_t>(product_rows_.count());
    work_.products.resize(product_rows * length(Sums));
    work_.product_planes.resize(planes * window_rows * length(Sums));
    if (kIsWeighted) work_.cell_weights.resize(planes * window_rows * length(1));
    work_.coefficients.resize(window_rows * length(Coefficients));
    work_.coefficient_planes.resize(planes * rows * length(Coefficients));
    if (Coefficients == 6) work_.rests.resize(planes * rows * length(1));
    const std::size_t padded = (registers_ + 2 * margin_) * kLanes;
    work_.product_row.assign(padded * Sums, T(0));
    work_.coefficient_row.assign(padded * Coefficients, T(0));
    if (Along == 0) {
      work_.apart.assign(padded, T(0));
      work_.summed.resize(length(1));
    }
    work_.shares.assign(length(1), T(0));
    work_.floors.assign(length(1), T(1));
    work_.own.assign(length(1), T(0));
    for (int x = 0; x < shape_.cells(0); ++x) {
      const auto at = static_cast<std::size_t>(x);
      work_.shares[at] = static_cast<T>(1 / shape_.samples_in_window(0, x));
      work_.floors[at] = static_cast<T>(shape_.floor2);
      work_.own[at] = static_cast<T>(shape_.samples_in_cell(0, x));
    }
  }

  /// Values of a row of so many quantities.
  std::size_t length(std::size_t quantities) const { return registers_ * kLanes * quantities; }
  std::size_t slot(int plane) const { return static_cast<std::size_t>(plane % shape_.window(2)); }
  T* row_of(LineVector<T>& planes, const SiteRange& rows, int row, int plane, std::size_t quantities) const {
    return planes.data() +
           (slot(plane) * static_cast<std::size_t>(rows.count()) + static_cast<std::size_t>(row - rows.begin)) *
               length(quantities);
  }
  std::size_t site(int row, int plane) const {  // of samples
    return static_cast<std::size_t>(shape_.size[0]) *
           (static_cast<std::size_t>(row) + static_cast<std::size_t>(shape_.size[1]) * static_cast<std::size_t>(plane));
  }

  /// Of a register of samples; 1 where none are given.
  [[gnu::always_inline]] const T* weights_at(std::size_t site) const {
    return scene_.weights ? scene_.weights + site : ones_.data();
  }

  /// The sums over cells of what samples give, of a plane of cells, and these along y.
  void take_plane(int plane) {
    for (int row = product_rows_.begin; row < product_rows_.end; ++row)
      take_row(row, plane, work_.products.data() + static_cast<std::size_t>(row - product_rows_.begin) * length(Sums));
    const std::size_t stride = length(Sums);
    for (int row = window_rows_.begin; row < window_rows_.end; ++row) {
      const T* first = work_.products.data();
      const int begin = product_rows_.begin;
      add_window(
          1, row, stride, [=](int i) { return first + static_cast<std::size_t>(i - begin) * stride; },
          row_of(work_.product_planes, window_rows_, row, plane, Sums));
      if constexpr (kIsWeighted) {
        const T* weights =
            work_.products.data() + static_cast<std::size_t>(row - product_rows_.begin) * stride + 5 * kLanes;
        T* to = row_of(work_.cell_weights, window_rows_, row, plane, 1);
        for (std::size_t i = 0; i < registers_; ++i) store<T>(load(weights + i * Sums * kLanes), to + i * kLanes);
      }
    }
  }

  /// to = sum of the rows, or planes, of the window at `at` along an axis, each of `length` values.
  template <class Row>
  [[gnu::always_inline]] void add_window(int axis, int at, std::size_t length, const Row& row, T* to) const {
    const int radius = shape_.radius(axis);
    const SiteRange inside = SiteRange{at, at + 1}.grown(radius, shape_.cells(axis));
    const T rim = static_cast<T>(shape_.rim(axis));
    if (radius == 1 && inside.count() == 3) {  // in one go
      const T *before = row(at - 1), *here = row(at), *after = row(at + 1);
      for (std::size_t i = 0; i < length; i += kLanes)
        store<T>(load(here + i) + rim * (load(before + i) + load(after + i)), to + i);
      return;
    }
    std::copy_n(row(at), length, to);
    for (int from = inside.begin; from < inside.end; ++from) {
      if (from == at) continue;
      const T counts = std::abs(from - at) == radius ? rim : T(1);
      const T* values = row(from);
      for (std::size_t i = 0; i < length; i += kLanes) store<T>(load(to + i) + counts * load(values + i), to + i);
    }
  }

  /// A row of samples and where it is in the images.
  struct SampleRows {
    std::array<std::size_t, 4> sites;
    int count = 0;
    std::size_t ahead = 0;  ///< to the same samples of the next plane of cells, where there is one
  };
  SampleRows samples_of(int row, int plane) const {
    SampleRows found;
    if (plane + 2 < shape_.cells(2)) found.ahead = site(0, shape_.cell(2));
    for (int dz = 0; dz < shape_.samples_in_cell(2, plane); ++dz)
      for (int dy = 0; dy < shape_.samples_in_cell(1, row); ++dy)
        found.sites[static_cast<std::size_t>(found.count++)] =
            site(row * shape_.cell(1) + dy, plane * shape_.cell(2) + dz);
    return found;
  }

  void take_row(int row, int plane, T* to) {
    const SampleRows rows = samples_of(row, plane);
    const auto width = static_cast<std::size_t>(shape_.size[0]);
    constexpr std::size_t step = Cell * kLanes;
    const std::size_t whole = width / step * step;
    for (std::size_t x = 0; x < whole; x += step, to += Sums * kLanes)
      take_cells(
          rows, x, [](const T* from, std::size_t, T) { return load(from); }, to);
    if (whole < width)
      take_cells(
          rows, whole,
          [=](const T* from, std::size_t at, T other) {
            return at < width ? load_first(width - at, from, other) : Lanes{} + other;
          },
          to);
  }

  /// Of a register of cells, from sample x on.
  template <class Read>
  [[gnu::always_inline]] void take_cells(const SampleRows& rows, std::size_t x, const Read& read, T* to) const {
    const T middle_f = scene_.middle_fixed, middle_w = scene_.middle_warped;
    Lanes sums[Cell][Sums] = {};
    for (int i = 0; i < rows.count; ++i) {
      const std::size_t site = rows.sites[static_cast<std::size_t>(i)];
#pragma GCC unroll 2
      for (std::size_t part = 0; part < Cell; ++part) {
        const std::size_t at = x + part * kLanes;
        Lanes f = read(scene_.fixed + site + at, at, middle_f) - middle_f,
              w = read(scene_.warped + site + at, at, middle_w) - middle_w, wf = f, ww = w;
        __builtin_prefetch(scene_.fixed + site + at + rows.ahead);
        __builtin_prefetch(scene_.warped + site + at + rows.ahead);
        if constexpr (kIsWeighted) {
          const Lanes weight = read(weights_at(site + at), at, T(0));
          f = weight != 0 ? f : Lanes{}, w = weight != 0 ? w : Lanes{};
          wf = weight * f, ww = weight * w;
          sums[part][5] += weight;
        }
        sums[part][0] += wf;
        sums[part][1] += ww;
        sums[part][2] += wf * f;
        sums[part][3] += ww * w;
        sums[part][4] += wf * w;
      }
    }
#pragma GCC unroll 6
    for (std::size_t k = 0; k < Sums; ++k) {
      if constexpr (Cell == 2)
        store<T>(every_second<0, T>(sums[0][k], sums[1][k]) + every_second<1, T>(sums[0][k], sums[1][k]),
                 to + k * kLanes);
      else
        store<T>(sums[0][k], to + k * kLanes);
    }
  }

  /// Of a row between margins, register by register.
  template <std::size_t Quantities>
  [[gnu::always_inline]] Window<Quantities> sums_along(T* row) {
    if (Along == 0 && shape_.radius(0) > 0) sum_wide<Quantities>(row);
    return {row, static_cast<T>(shape_.rim(0))};
  }
  /// In place, over windows that RimmedRowWindow does not know.
  template <std::size_t Quantities>
  void sum_wide(T* row) {
    const std::size_t count = registers_ * kLanes, margin = margin_ * kLanes;
    const int radius = shape_.radius(0);
    for (std::size_t k = 0; k < Quantities; ++k) {
      const auto at = [=](std::size_t i) { return (i / kLanes * Quantities + k) * kLanes + i % kLanes; };
      T *apart = work_.apart.data() + margin, *summed = work_.summed.data();  // margins are 0
      for (std::size_t i = 0; i < count; ++i) apart[i] = summed[i] = row[at(i)];
      for (int by = 1; by <= radius; ++by) {
        const T counts = by == radius ? static_cast<T>(shape_.rim(0)) : T(1);
#pragma omp simd
        for (std::size_t i = 0; i < count; ++i)
          summed[i] += counts * (apart[static_cast<long>(i) - by] + apart[i + static_cast<std::size_t>(by)]);
      }
      for (std::size_t i = 0; i < count; ++i) row[at(i)] = summed[i];
    }
  }

  /// Those of the windows of a plane, and their sums along x and y.
  void find_coefficients(int plane) {
    const std::size_t stride = length(Coefficients);
    T* products = work_.product_row.data() + margin_ * Sums * kLanes;
    double energy = 0;
    for (int row = window_rows_.begin; row < window_rows_.end; ++row) {
      add_window(
          2, plane, length(Sums), [&](int i) { return row_of(work_.product_planes, window_rows_, row, i, Sums); },
          products);
      T* to = work_.coefficients.data() + static_cast<std::size_t>(row - window_rows_.begin) * stride;
      const double of_row = find_row(row, plane, sums_along<Sums>(products), to);
      if (tile_.rows.holds(row)) energy += of_row;
    }
    if (tile_.planes.holds(plane)) energies_[plane - tile_.planes.begin] = shape_.volume * energy;

    T* padded = work_.coefficient_row.data() + margin_ * Coefficients * kLanes;
    for (int row = tile_.rows.begin; row < tile_.rows.end; ++row) {
      const T* first = work_.coefficients.data();
      const int begin = window_rows_.begin;
      add_window(
          1, row, stride, [=](int i) { return first + static_cast<std::size_t>(i - begin) * stride; }, padded);
      Window<Coefficients> sums = sums_along<Coefficients>(padded);
      T* to = row_of(work_.coefficient_planes, tile_.rows, row, plane, Coefficients);
      for (std::size_t i = 0; i < registers_; ++i, to += Coefficients * kLanes) {
        Lanes k[Coefficients];
        sums.next(k);
#pragma GCC unroll 6
        for (std::size_t c = 0; c < Coefficients; ++c) store<T>(k[c], to + c * kLanes);
      }
    }
  }

  /// Writes the coefficients of a row of windows; its energy a volume. Without weights a window's samples are counted.
  double find_row(int row, int plane, Window<Sums> windows, T* to) {
    const T volume = static_cast<T>(shape_.volume);
    const T across = static_cast<T>(1 / (shape_.samples_in_window(1, row) * shape_.samples_in_window(2, plane)));
    const T own_across = static_cast<T>(shape_.samples_in_cell(1, row) * shape_.samples_in_cell(2, plane));
    const T *shares = work_.shares.data(), *floors = work_.floors.data(), *own = work_.own.data();
    const T* weights = kIsWeighted ? row_of(work_.cell_weights, window_rows_, row, plane, 1) : nullptr;
    T* rests = Coefficients == 6 && tile_.rows.holds(row) ? row_of(work_.rests, tile_.rows, row, plane, 1) : nullptr;
    const std::size_t count = length(1);
    Lanes energy = {};
    const auto begin = [&](std::size_t x) __attribute__((always_inline)) {
      WindowCorrelation<T> window;
      Lanes s[Sums];
      windows.next(s);
      if constexpr (kIsWeighted) {
        window.find_weighted(s, load(weights + x), load(floors + x), Coefficients == 6);
      } else {
        window.weight = own_across * load(own + x);
        window.find(s, across * load(shares + x), load(floors + x));
      }
      return window;
    };
    const auto finish = [&](std::size_t x, const WindowCorrelation<T>& window) __attribute__((always_inline)) {
      Lanes k[Coefficients];
      window.find_coefficients(volume * window.weight * window.share, k);
#pragma GCC unroll 6
      for (std::size_t i = 0; i < Coefficients; ++i) store<T>(k[i], to + i * kLanes);
      to += Coefficients * kLanes;
      Lanes rest = 1 - window.correlation();
      if constexpr (kIsWeighted) rest = 1 - window.seen * window.correlation();
      energy += window.weight * rest;
      if constexpr (Coefficients == 6)
        if (rests) store<T>(volume * rest, rests + x);
    };
    for_windows<Coefficients == 6, T>(count, begin, finish);
    double sum = 0;  // a row's in T, then in double
    for (std::size_t lane = 0; lane < kLanes; ++lane) sum += double(energy[lane]);
    return sum;
  }

  /// Of the samples of a plane of cells.
  void find_gradients(int plane) {
    const auto width = static_cast<std::size_t>(shape_.size[0]);
    constexpr std::size_t step = Cell * kLanes;
    const std::size_t whole = width / step * step;
    for (int row = tile_.rows.begin; row < tile_.rows.end; ++row) {
      const SampleRows rows = samples_of(row, plane);
      T* sums = work_.coefficients.data();  // of this plane no longer needed
      add_window(
          2, plane, length(Coefficients),
          [&](int i) { return row_of(work_.coefficient_planes, tile_.rows, row, i, Coefficients); }, sums);
      const T* rests = Coefficients == 6 ? row_of(work_.rests, tile_.rows, row, plane, 1) : nullptr;
      for (std::size_t x = 0; x < whole; x += step, sums += Coefficients * kLanes)
        find_of_cells(
            rows, x, sums, rests, [](const T* from, std::size_t) { return load(from); },
            [](const Lanes& values, std::size_t, T* to) { store<T>(values, to); });
      if (whole < width)
        find_of_cells(
            rows, whole, sums, rests,
            [=](const T* from, std::size_t at) { return at < width ? load_first(width - at, from, T(0)) : Lanes{}; },
            [=](const Lanes& values, std::size_t at, T* to) {
              if (at < width) store_first<T>(width - at, values, to);
            });
    }
  }

  /// Of a register of cells, from sample x on, with the window sums `s` of its coefficients.
  template <class Read, class Write>
  [[gnu::always_inline]] void find_of_cells(const SampleRows& rows, std::size_t x, const T* sums, const T* rests,
                                            const Read& read, const Write& write) const {
    const T middle_f = scene_.middle_fixed, middle_w = scene_.middle_warped;
    Lanes s[Cell][Coefficients], rest[Cell] = {};
#pragma GCC unroll 6
    for (std::size_t k = 0; k < Coefficients; ++k) of_samples(load(sums + k * kLanes), k, s);
    if constexpr (Coefficients == 6) {
      const Lanes own = load(rests + x / Cell);
      rest[0] = Cell == 2 ? doubled<0, T>(own) : own;
      if constexpr (Cell == 2) rest[1] = doubled<1, T>(own);
    }
    for (int i = 0; i < rows.count; ++i) {
#pragma GCC unroll 2
      for (std::size_t part = 0; part < Cell; ++part) {
        const std::size_t at = x + part * kLanes, site = rows.sites[static_cast<std::size_t>(i)] + at;
        const Lanes f = read(scene_.fixed + site, at) - middle_f, w = read(scene_.warped + site, at) - middle_w;
        __builtin_prefetch(scene_.gradient + site + rows.ahead, 1);
        if constexpr (!kIsWeighted) {
          write(w * s[part][1] + s[part][2] - f * s[part][0], at, scene_.gradient + site);
        } else {
          const Lanes weight = read(weights_at(site), at);
          const Lanes slope = weight * (w * s[part][1] + s[part][2] - f * s[part][0]);
          write(weight == 0 ? Lanes{} : slope, at, scene_.gradient + site);
          if constexpr (Coefficients == 6)  // also of what is hidden
            write(rest[part] + w * (s[part][2] - f * s[part][0] + T(0.5) * w * s[part][1]) +
                      f * (T(0.5) * f * s[part][3] - s[part][4]) - s[part][5],
                  at, scene_.weight_gradient + site);
        }
      }
    }
  }
  [[gnu::always_inline]] static void of_samples(const Lanes& cells, std::size_t k, Lanes (&s)[Cell][Coefficients]) {
    s[0][k] = Cell == 2 ? doubled<0, T>(cells) : cells;
    if constexpr (Cell == 2) s[1][k] = doubled<1, T>(cells);
  }

  const CellShape& shape_;
  const CellScene<T> scene_;
  const CellTile tile_;
  CellWork<T>& work_;
  std::size_t registers_, margin_;        ///< of a row of cells, and of what is 0 on both sides of it
  SiteRange window_rows_, product_rows_;  ///< of cells: whose windows the tile's samples are in, and what these hold
  SiteRange windows_, products_;          ///< the same of planes
  std::array<T, kLanes> ones_;
  double* energies_ = nullptr;
};

}  // namespace saltus
