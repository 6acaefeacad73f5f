#pragma once

#include <algorithm>
#include <cstddef>

namespace saltus {

/// sum[x] += entering[x] - leaving[x], for a window that moves on by one row; null where it has no row to take or to
/// give. In double: what entered in float leaves again without a trace, so that a flat window after an edge is flat.
template <class T>
void slide_window(std::size_t count, const T* entering, const T* leaving, double* sum) {
  if (entering && leaving) {
#pragma omp simd
    for (std::size_t x = 0; x < count; ++x) sum[x] += double(entering[x]) - double(leaving[x]);
  } else if (entering) {
#pragma omp simd
    for (std::size_t x = 0; x < count; ++x) sum[x] += double(entering[x]);
  } else if (leaving) {
#pragma omp simd
    for (std::size_t x = 0; x < count; ++x) sum[x] -= double(leaving[x]);
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
