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

/// The same of rows that are `apart`.
template <class T>
void sum_few(int terms, std::size_t apart, std::size_t width, const T* from, T* to) {
  sum_rows(
      terms, width, [&](int i) { return from + static_cast<std::size_t>(i) * apart; }, to);
}

/// Along lines of samples with `channels` values each, which follow each other.
template <class T>
void sum_few_along(int length, int radius, std::size_t channels, const T* in, T* out) {
  const auto put = [&](int from, int to) {  // of samples that see as many others as the first of them
    const int first = std::max(0, from - radius), last = std::min(length - 1, from + radius);
    sum_few(last - first + 1, channels, static_cast<std::size_t>(to - from) * channels,
            in + static_cast<std::size_t>(first) * channels, out + static_cast<std::size_t>(from) * channels);
  };
  const int begin = std::min(radius, length), end = std::max(begin, length - radius);
  for (int i = 0; i < begin; ++i) put(i, i + 1);
  if (begin < end) put(begin, end);
  for (int i = end; i < length; ++i) put(i, i + 1);
}

/// out_i = sum of in_j over |j - i| <= radius, cut at the ends, of `length` rows of `width` values side by side; rows
/// are `in_stride` and `out_stride` values apart. `in` and `out` must not overlap.
template <class T>
void box_sum_rows(int length, int radius, std::size_t width, const T* in, std::size_t in_stride, T* out,
                  std::size_t out_stride) {
  radius = std::min(radius, length - 1);
  if (radius <= kFewAside) {
    for (int i = 0; i < length; ++i) {
      const int first = std::max(0, i - radius), last = std::min(length - 1, i + radius);
      sum_few(last - first + 1, in_stride, width, in + static_cast<std::size_t>(first) * in_stride,
              out + static_cast<std::size_t>(i) * out_stride);
    }
    return;
  }
  if (width == 1) return add_running_sums<1>(length, radius, width, in, in_stride, out, out_stride);  // along x
  for (std::size_t begin = 0; begin < width; begin += kStrip)
    add_running_sums<0>(length, radius, std::min(kStrip, width - begin), in + begin, in_stride, out + begin,
                        out_stride);
}

/// The lines along one axis, of which `across` lie side by side: as far is it from a value to the next one.
struct Axis {
  int length, radius;
  std::size_t across;

  bool needs_sums() const { return radius > 0 && length > 1; }
  bool is_summed_anew() const { return std::min(radius, length - 1) <= kFewAside; }
  /// Lines that are summed together, by way of a copy that the second cache holds.
  std::size_t strip() const {
    constexpr std::size_t fewest = 16, values = 1 << 16;
    return is_summed_anew() ? kStrip : std::clamp(values / static_cast<std::size_t>(length), fewest, kStrip);
  }
  std::size_t strips() const { return (across + strip() - 1) / strip(); }
  /// Values of that copy: running sums need all that has been written over, others a few rows.
  std::size_t copied() const {
    return std::min(strip(), across) * static_cast<std::size_t>(is_summed_anew() ? kFewAside + 1 : length);
  }
};

/// Lines from `first` on, in place.
template <class T>
void sum_strip(const Axis& axis, std::size_t first, T* field, T* copy) {
  const std::size_t width = std::min(axis.strip(), axis.across - first);
  const int radius = std::min(axis.radius, axis.length - 1);
  const auto row = [&](int i) { return field + first + static_cast<std::size_t>(i) * axis.across; };
  if (!axis.is_summed_anew()) {
    for (int i = 0; i < axis.length; ++i) std::copy_n(row(i), width, copy + static_cast<std::size_t>(i) * width);
    return box_sum_rows(axis.length, radius, width, copy, width, row(0), axis.across);
  }
  const auto kept = [&](int i) { return copy + static_cast<std::size_t>(i % (kFewAside + 1)) * width; };
  for (int i = 0; i < axis.length; ++i) {
    std::copy_n(row(i), width, kept(i));
    const int begin = std::max(0, i - radius), end = std::min(axis.length, i + radius + 1);
    const auto before = [&](int k) -> const T* { return begin + k <= i ? kept(begin + k) : row(begin + k); };
    sum_rows(end - begin, width, before, row(i));
  }
}

/// The same along x, for one row: `across` are its channels.
template <class T>
void sum_row(const Axis& axis, T* row, T* copy) {
  std::copy_n(row, static_cast<std::size_t>(axis.length) * axis.across, copy);
  if (axis.is_summed_anew())
    sum_few_along(axis.length, axis.radius, axis.across, copy, row);
  else
    box_sum_rows(axis.length, axis.radius, axis.across, copy, axis.across, row, axis.across);
}

}  // namespace

template <int Dim, class T>
void BoxSum<Dim, T>::apply(int channels, T* field) const {
  const auto length = [&](int axis) { return static_cast<std::size_t>(lattice_.size[axis]); };
  const std::size_t row = static_cast<std::size_t>(channels) * length(0);
  const std::size_t rows_of_slab = Dim == 3 ? length(1) : 1, slab = rows_of_slab * row, slabs = length(Dim - 1);
  const Axis x{lattice_.size[0], radius_[0], static_cast<std::size_t>(channels)};
  const Axis y{Dim == 3 ? lattice_.size[1] : 1, radius_[1], row}, last{lattice_.size[Dim - 1], radius_[Dim - 1], slab};
  const std::size_t copied = std::max({row, y.copied(), last.copied()});
  // A slab is summed along x and y at once, while the cache still holds it, unless there are too few to share out.
  const auto threads = static_cast<std::size_t>(threads_of_loop(slabs * slab));
  const bool shares_slabs = (slabs + threads - 1) / threads * threads > slabs + slabs / 4;
#pragma omp parallel num_threads(static_cast <int>(threads))
  {
    std::vector<T> copy(copied);
    const auto along_x = [&](std::size_t which) {
      if (x.needs_sums()) sum_row(x, field + which * row, copy.data());
    };
    const auto along_y = [&](std::size_t which, std::size_t strip) {
      if (y.needs_sums()) sum_strip(y, strip * y.strip(), field + which * slab, copy.data());
    };
    if (shares_slabs) {
#pragma omp for schedule(static)
      for (std::size_t k = 0; k < slabs * rows_of_slab; ++k) along_x(k);
#pragma omp for collapse(2) schedule(static)
      for (std::size_t which = 0; which < slabs; ++which)
        for (std::size_t strip = 0; strip < y.strips(); ++strip) along_y(which, strip);
    } else {
#pragma omp for schedule(static)
      for (std::size_t which = 0; which < slabs; ++which) {
        for (std::size_t k = 0; k < rows_of_slab; ++k) along_x(which * rows_of_slab + k);
        for (std::size_t strip = 0; strip < y.strips(); ++strip) along_y(which, strip);
      }
    }
#pragma omp for schedule(static)
    for (std::size_t strip = 0; strip < last.strips(); ++strip)
      if (last.needs_sums()) sum_strip(last, strip * last.strip(), field, copy.data());
  }
}

template class BoxSum<2, float>;
template class BoxSum<3, float>;
template class BoxSum<2, double>;
template class BoxSum<3, double>;

}  // namespace saltus
