#include "core/similarity/box_sum.h"

#include "core/support/thread_count.h"

#include <algorithm>
#include <type_traits>
#include <vector>

namespace saltus {

namespace {

constexpr std::size_t kStrip = 256;  ///< lines that are summed together: their sums stay in the nearest cache

/// With `Width` known (0: not), sums stay in registers.
template <std::size_t Width, class T>
void add_running_sums(int length, int radius, std::size_t any_width, const T* in, std::size_t in_stride, T* out,
                      std::size_t out_stride) {
  const std::size_t width = Width > 0 ? Width : any_width;
  // A float sum would drift along a line, and flat windows would not look flat.
  double sum[Width > 0 ? Width : kStrip] = {};
  for (int i = 0; i < radius; ++i)
    for (std::size_t k = 0; k < width; ++k) sum[k] += in[static_cast<std::size_t>(i) * in_stride + k];
  for (int i = 0; i < length; ++i) {
    const T* entering = i + radius < length ? in + static_cast<std::size_t>(i + radius) * in_stride : nullptr;
    const T* leaving = i - radius - 1 >= 0 ? in + static_cast<std::size_t>(i - radius - 1) * in_stride : nullptr;
    T* to = out + static_cast<std::size_t>(i) * out_stride;
    if (entering && leaving) {
#pragma omp simd
      for (std::size_t k = 0; k < width; ++k) to[k] = static_cast<T>(sum[k] += double(entering[k]) - leaving[k]);
    } else {
      for (std::size_t k = 0; k < width; ++k)
        to[k] = static_cast<T>(sum[k] += (entering ? double(entering[k]) : 0.0) - (leaving ? double(leaving[k]) : 0.0));
    }
  }
}

/// Boxes of up to so many samples on either side are summed anew: less work than to convert what enters and leaves, and
/// too few terms for a float sum to lose anything.
constexpr int kFewAside = 2;

/// to[k] = sum over i < terms of row(i)[k]; `to` is none of them.
template <class T, class Row>
[[gnu::always_inline]] inline void sum_rows(int terms, std::size_t width, const Row& row, T* to) {
  const auto sum = [&](auto count) {
    const T* rows[count];
    for (int i = 0; i < count; ++i) rows[i] = row(i);
#pragma omp simd
    for (std::size_t k = 0; k < width; ++k) {
      T all = rows[0][k];
      for (int i = 1; i < count; ++i) all += rows[i][k];
      to[k] = all;
    }
  };
  switch (terms) {
    case 1:
      return sum(std::integral_constant<int, 1>());
    case 2:
      return sum(std::integral_constant<int, 2>());
    case 3:
      return sum(std::integral_constant<int, 3>());
    case 4:
      return sum(std::integral_constant<int, 4>());
    default:
      static_assert(2 * kFewAside + 1 == 5);
      return sum(std::integral_constant<int, 5>());
  }
}

/// Along a line whose values follow each other.
template <class T>
void sum_few_along(int length, int radius, const T* in, T* out) {
  const auto put = [&](int from, int to) {  // of samples that see as many others as the first of them
    const int first = std::max(0, from - radius), last = std::min(length - 1, from + radius);
    sum_rows(
        last - first + 1, static_cast<std::size_t>(to - from), [&](int i) { return in + first + i; }, out + from);
  };
  const int begin = std::min(radius, length), end = std::max(begin, length - radius);
  for (int i = 0; i < begin; ++i) put(i, i + 1);
  if (begin < end) put(begin, end);
  for (int i = end; i < length; ++i) put(i, i + 1);
}

/// The lines along one axis, of which `across` lie side by side, so that a line's values are as far apart.
struct Axis {
  Axis(int values, int reach, std::size_t lines) : length(values), radius(std::min(reach, values - 1)), across(lines) {}

  int length, radius;
  std::size_t across;

  bool needs_sums() const { return radius > 0; }
  bool is_summed_anew() const { return radius <= kFewAside; }
  /// Lines that are summed together, by way of a copy that the second cache holds.
  template <class T>
  std::size_t lines_of_strip() const {
    constexpr std::size_t fewest = 64 / sizeof(T);
    if (is_summed_anew()) return kStrip;
    return std::clamp(kBoxSumCopy / sizeof(T) / static_cast<std::size_t>(length), fewest, kStrip);
  }
  template <class T>
  std::size_t strips() const {
    return (across + lines_of_strip<T>() - 1) / lines_of_strip<T>();
  }
  /// Values of that copy: running sums need all that has been written over, others a few rows.
  template <class T>
  std::size_t copy_size() const {
    return std::min(lines_of_strip<T>(), across) * static_cast<std::size_t>(is_summed_anew() ? kFewAside + 1 : length);
  }
};

/// One strip of lines, in place.
template <class T>
void sum_strip(const Axis& axis, std::size_t strip, T* field, T* copy) {
  const std::size_t first = strip * axis.lines_of_strip<T>();
  const std::size_t width = std::min(axis.lines_of_strip<T>(), axis.across - first);
  const auto row = [&](int i) { return field + first + static_cast<std::size_t>(i) * axis.across; };
  if (!axis.is_summed_anew()) {
    for (int i = 0; i < axis.length; ++i) std::copy_n(row(i), width, copy + static_cast<std::size_t>(i) * width);
    return add_running_sums<0>(axis.length, axis.radius, width, copy, width, row(0), axis.across);
  }
  const auto kept = [&](int i) { return copy + static_cast<std::size_t>(i % (kFewAside + 1)) * width; };
  for (int i = 0; i < axis.length; ++i) {
    std::copy_n(row(i), width, kept(i));
    const int begin = std::max(0, i - axis.radius), end = std::min(axis.length, i + axis.radius + 1);
    const auto unsummed = [&](int k) -> const T* { return begin + k <= i ? kept(begin + k) : row(begin + k); };
    sum_rows(end - begin, width, unsummed, row(i));
  }
}

/// Along x, one row in place.
template <class T>
void sum_row(const Axis& axis, T* row, T* copy) {
  std::copy_n(row, static_cast<std::size_t>(axis.length), copy);
  if (axis.is_summed_anew()) return sum_few_along(axis.length, axis.radius, copy, row);
  add_running_sums<1>(axis.length, axis.radius, 1, copy, 1, row, 1);
}

}  // namespace

template <int Dim, class T>
void BoxSum<Dim, T>::apply(T* field) const {
  const auto length = [&](int axis) { return static_cast<std::size_t>(lattice_.size[axis]); };
  const std::size_t row = length(0), rows_of_slab = Dim == 3 ? length(1) : 1, slab = rows_of_slab * row,
                    slabs = length(Dim - 1);
  const Axis x(lattice_.size[0], radius_[0], 1);
  const Axis y(Dim == 3 ? lattice_.size[1] : 1, radius_[1], row);  // in the plane of length 1: there is nothing to sum
  const Axis last(lattice_.size[Dim - 1], radius_[Dim - 1], slab);
  const std::size_t copy_size = std::max({row, y.copy_size<T>(), last.copy_size<T>()});
  // A slab is summed along x and y at once, while the cache still holds it, unless there are too few to share out.
  const auto threads = static_cast<std::size_t>(threads_of_loop(slabs * slab));
  const bool shares_slabs = (slabs + threads - 1) / threads * threads > slabs + slabs / 4;
#pragma omp parallel num_threads(static_cast <int>(threads))
  {
    std::vector<T> copy(copy_size);
    const auto along_x = [&](std::size_t which) {
      if (x.needs_sums()) sum_row(x, field + which * row, copy.data());
    };
    const auto along_y = [&](std::size_t which, std::size_t strip) {
      if (y.needs_sums()) sum_strip(y, strip, field + which * slab, copy.data());
    };
    if (shares_slabs) {
#pragma omp for schedule(static)
      for (std::size_t k = 0; k < slabs * rows_of_slab; ++k) along_x(k);
#pragma omp for collapse(2) schedule(static)
      for (std::size_t which = 0; which < slabs; ++which)
        for (std::size_t strip = 0; strip < y.strips<T>(); ++strip) along_y(which, strip);
    } else {
#pragma omp for schedule(static)
      for (std::size_t which = 0; which < slabs; ++which) {
        for (std::size_t k = 0; k < rows_of_slab; ++k) along_x(which * rows_of_slab + k);
        for (std::size_t strip = 0; strip < y.strips<T>(); ++strip) along_y(which, strip);
      }
    }
#pragma omp for schedule(static)
    for (std::size_t strip = 0; strip < last.strips<T>(); ++strip)
      if (last.needs_sums()) sum_strip(last, strip, field, copy.data());
  }
}

template class BoxSum<2, float>;
template class BoxSum<3, float>;
template class BoxSum<2, double>;
template class BoxSum<3, double>;

}  // namespace saltus
