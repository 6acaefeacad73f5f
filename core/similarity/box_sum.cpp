#include "core/similarity/box_sum.h"

#include "core/support/thread_count.h"

#include <algorithm>
#include <type_traits>
#include <vector>

namespace saltus {

namespace {

constexpr std::size_t kStrip = 256;  ///< rows that run together: their sums stay in the nearest cache

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

}  // namespace

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

namespace {

/// Lines of `length` values along one axis, which lie side by side in `width` columns: rows `stride` apart.
template <class T>
struct Lines {
  int length, radius;
  std::size_t width, stride;

  bool need_sums() const { return radius > 0 && length > 1; }
};

/// In place, a strip of columns at a time. `copy` holds what is needed of the rows that are written over already.
template <class T>
void sum_lines(const Lines<T>& lines, std::size_t begin, T* field, std::vector<T>& copy) {
  const std::size_t width = std::min(kStrip, lines.width - begin), stride = lines.stride;
  const int length = lines.length, radius = std::min(lines.radius, length - 1);
  T* strip = field + begin;
  if (radius > kFewAside) {
    copy.resize(std::max(copy.size(), static_cast<std::size_t>(length) * width));
    for (int i = 0; i < length; ++i)
      std::copy_n(strip + static_cast<std::size_t>(i) * stride, width,
                  copy.data() + static_cast<std::size_t>(i) * width);
    return box_sum_rows(length, radius, width, copy.data(), width, strip, stride);
  }
  constexpr int kept = kFewAside + 1;
  copy.resize(std::max(copy.size(), kept * width));
  const auto kept_row = [&](int i) { return copy.data() + static_cast<std::size_t>(i % kept) * width; };
  for (int i = 0; i < length; ++i) {
    T* own = strip + static_cast<std::size_t>(i) * stride;
    std::copy_n(own, width, kept_row(i));
    const int first = std::max(0, i - radius), last = std::min(length - 1, i + radius);
    const auto row = [&](int k) -> const T* {
      return first + k <= i ? kept_row(first + k) : strip + static_cast<std::size_t>(first + k) * stride;
    };
    sum_rows(last - first + 1, width, row, own);
  }
}

/// The same along rows of `length` samples with `channels` values each.
template <class T>
void sum_row(int length, int radius, std::size_t channels, T* row, std::vector<T>& copy) {
  const std::size_t values = static_cast<std::size_t>(length) * channels;
  copy.resize(std::max(copy.size(), values));
  std::copy_n(row, values, copy.data());
  if (radius <= kFewAside)
    sum_few_along(length, radius, channels, copy.data(), row);
  else
    box_sum_rows(length, radius, channels, copy.data(), channels, row, channels);
}

}  // namespace

template <int Dim, class T>
void BoxSum<Dim, T>::apply(int channels, T* field) const {
  const auto values = static_cast<std::size_t>(channels);
  const std::size_t row = values * static_cast<std::size_t>(lattice_.size[0]),
                    rows = lattice_.sites() / static_cast<std::size_t>(lattice_.size[0]);
  const auto length = [&](int axis) { return lattice_.size[axis]; };
  // Along x, and in space along y as long as a plane is in the cache; then across all of these.
  const std::size_t rows_of_slab = Dim == 3 ? static_cast<std::size_t>(length(1)) : 1, slab = rows_of_slab * row;
  const Lines<T> along_y{Dim == 3 ? length(1) : 1, Dim == 3 ? radius_[1] : 0, row, row},
      across{length(Dim - 1), radius_[Dim - 1], slab, slab};
#pragma omp parallel if (is_worth_threads(lattice_.sites() * values))
  {
    std::vector<T> copy;
#pragma omp for schedule(static)
    for (std::size_t first = 0; first < rows; first += rows_of_slab) {
      T* from = field + first * row;
      if (length(0) > 1 && radius_[0] > 0)
        for (std::size_t k = 0; k < rows_of_slab; ++k) sum_row(length(0), radius_[0], values, from + k * row, copy);
      if (along_y.need_sums())
        for (std::size_t begin = 0; begin < row; begin += kStrip) sum_lines(along_y, begin, from, copy);
    }
    if (across.need_sums())
#pragma omp for schedule(static)
      for (std::size_t begin = 0; begin < slab; begin += kStrip) sum_lines(across, begin, field, copy);
  }
}

template void box_sum_rows(int, int, std::size_t, const float*, std::size_t, float*, std::size_t);
template void box_sum_rows(int, int, std::size_t, const double*, std::size_t, double*, std::size_t);
template class BoxSum<2, float>;
template class BoxSum<3, float>;
template class BoxSum<2, double>;
template class BoxSum<3, double>;

}  // namespace saltus
