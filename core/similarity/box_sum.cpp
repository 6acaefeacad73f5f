#include "core/similarity/box_sum.h"

#include "core/support/thread_count.h"

#include <algorithm>

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

/// to[k] = sum over i < terms of from[k + i * apart]
template <class T>
void sum_few(int terms, std::size_t apart, std::size_t width, const T* from, T* to) {
  if (terms == 1) {
    std::copy_n(from, width, to);
  } else if (terms == 2) {
#pragma omp simd
    for (std::size_t k = 0; k < width; ++k) to[k] = from[k] + from[k + apart];
  } else {
#pragma omp simd
    for (std::size_t k = 0; k < width; ++k) to[k] = from[k] + from[k + apart] + from[k + 2 * apart];
  }
  for (int i = 3; i < terms; ++i) {
    const T* next = from + static_cast<std::size_t>(i) * apart;
#pragma omp simd
    for (std::size_t k = 0; k < width; ++k) to[k] += next[k];
  }
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

template <int Dim, class T>
void BoxSum<Dim, T>::apply(int channels, T* field) {
  const std::size_t count = lattice_.sites() * static_cast<std::size_t>(channels);
  scratch_.resize(std::max(scratch_.size(), count));
  T* in = field;
  T* out = scratch_.data();
  std::size_t inner = static_cast<std::size_t>(channels);
  for (int axis = 0; axis < Dim; ++axis) {
    const int length = lattice_.size[axis];
    if (radius_[axis] > 0 && length > 1) {
      const std::size_t outer = count / (inner * static_cast<std::size_t>(length));
      // Lines along x are short rows of `channels`; along other axes whole rows run together, in strips.
      const std::size_t strips = (inner + kStrip - 1) / kStrip;
      const bool are_few_along_x = axis == 0 && strips == 1 && radius_[axis] <= kFewAside;
#pragma omp parallel for collapse(2) schedule(static) if (is_worth_threads(count))
      for (std::size_t o = 0; o < outer; ++o)
        for (std::size_t part = 0; part < strips; ++part) {
          const std::size_t begin = part * kStrip, at = o * inner * static_cast<std::size_t>(length) + begin;
          if (are_few_along_x)
            sum_few_along(length, radius_[axis], inner, in + at, out + at);
          else
            box_sum_rows(length, radius_[axis], std::min(kStrip, inner - begin), in + at, inner, out + at, inner);
        }
      std::swap(in, out);
    }
    inner *= static_cast<std::size_t>(length);
  }
  if (in != field) std::copy(in, in + count, field);
}

template void box_sum_rows(int, int, std::size_t, const float*, std::size_t, float*, std::size_t);
template void box_sum_rows(int, int, std::size_t, const double*, std::size_t, double*, std::size_t);
template class BoxSum<2, float>;
template class BoxSum<3, float>;
template class BoxSum<2, double>;
template class BoxSum<3, double>;

}  // namespace saltus
