#pragma once

#include <algorithm>
#include <cstddef>

#include "core/support/registers.h"

namespace saltus {

/// to[x] = the sum of `rows` values first[x], first[x + row_stride], ..., for `count` of them.
template <class T>
void sum_rows(int rows, std::size_t row_stride, const T* first, std::size_t count, T* to) {
  constexpr std::size_t lanes = kRegisterLanes<T>;
  std::size_t x = 0;
  for (; x + 2 * lanes <= count; x += 2 * lanes) {
    const T* from = first + x;
    Register<T> low = load(from), high = load(from + lanes);
    for (int row = 1; row < rows; ++row) {
      from += row_stride;
      low += load(from);
      high += load(from + lanes);
    }
    store(low, to + x);
    store(high, to + x + lanes);
  }
  for (; x < count; ++x) {
    T sum = first[x];
    for (int row = 1; row < rows; ++row) sum += first[x + static_cast<std::size_t>(row) * row_stride];
    to[x] = sum;
  }
}

template <int Width, class T>
void sum_known_width(std::size_t count, const T* padded, T* out) {
#pragma omp simd
  for (std::size_t x = 0; x < count; ++x) {
    T sum = padded[x];
    for (int j = 1; j < Width; ++j) sum += padded[x + j];
    out[x] = sum;
  }
}

/// out[x] = sum of padded[x + j] over 0 <= j <= 2 radius, for `count` values x. `padded` has count + 2 radius values
/// and is overwritten. Sums of 1, 2, 4, ... neighbours are put together, so nothing is carried along the row and the
/// cost grows with the logarithm of the radius.
template <class T>
void sum_along_row(std::size_t count, int radius, T* padded, T* out) {
  switch (radius) {
    case 0:
      std::copy_n(padded, count, out);
      return;
    case 1:
      return sum_known_width<3>(count, padded, out);
    case 2:
      return sum_known_width<5>(count, padded, out);
    case 3:
      return sum_known_width<7>(count, padded, out);
    default:
      break;
  }
  const std::size_t width = 2 * static_cast<std::size_t>(radius) + 1;
  std::size_t summed = 0;  // neighbours that are in `out`
  std::fill_n(out, count, T(0));
  for (std::size_t w = 1; w <= width; w *= 2) {  // padded[x] holds the sum of w values from x on
    if (width & w) {
      const T* from = padded + summed;
#pragma omp simd
      for (std::size_t x = 0; x < count; ++x) out[x] += from[x];
      summed += w;
    }
    const std::size_t left = count + width - 1 - std::min(count + width - 1, 2 * w - 1);
    for (std::size_t x = 0; x < left; ++x) padded[x] += padded[x + w];
  }
}

}  // namespace saltus
