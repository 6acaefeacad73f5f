#pragma once

#include "core/grid/lattice.h"
#include "core/kernels/separable_convolution.h"
#include "core/support/registers.h"
#include "core/support/thread_count.h"

#include <algorithm>
#include <cstring>
#include <vector>

namespace saltus {

/// out row i (+)= sum over taps of tap * value, for `Rows` rows of `Registers` registers of neighbouring values. The
/// value of the first tap of row 0 stands at `first`, that of each next tap one `step` before, that of each next row
/// one `step` after: rows share what they read. Sums are made in the order of the taps, all of them at once, so that
/// none waits for another.
template <int Rows, int Registers, class T>
[[gnu::always_inline]] inline void sum_taps(const std::vector<T>& taps, const T* first, std::size_t step, bool adds,
                                            T* out, std::size_t out_step) {
  constexpr std::size_t lanes = kRegisterLanes<T>;
  const int count = static_cast<int>(taps.size());
  Register<T> sum[Rows][Registers] = {};
  if (adds)
    for (int row = 0; row < Rows; ++row)
      for (int v = 0; v < Registers; ++v) sum[row][v] = load(out + row * out_step + v * lanes);
  const T* values = first + (Rows - 1) * step;
  // Row r takes tap k - (Rows - 1) + r of the values at hand; at both ends some rows have none.
  const auto take = [&](int k, auto is_whole) {
    Register<T> at_hand[Registers];
#pragma GCC unroll 8
    for (int v = 0; v < Registers; ++v) at_hand[v] = load(values + v * lanes);
#pragma GCC unroll 4
    for (int row = 0; row < Rows; ++row) {
      const int tap = k - (Rows - 1) + row;
      if (!is_whole && (tap < 0 || tap >= count)) continue;
      const T factor = taps[static_cast<std::size_t>(tap)];
#pragma GCC unroll 8
      for (int v = 0; v < Registers; ++v) sum[row][v] += factor * at_hand[v];
    }
    values -= step;
  };
  int k = 0;
  for (; k < std::min(Rows - 1, count); ++k) take(k, std::false_type());
  for (; k < count; ++k) take(k, std::true_type());
  for (; k < count + Rows - 1; ++k) take(k, std::false_type());
#pragma GCC unroll 4
  for (int row = 0; row < Rows; ++row)
#pragma GCC unroll 8
    for (int v = 0; v < Registers; ++v) store(sum[row][v], out + row * out_step + v * lanes);
}

/// The same for a row of `count` values.
template <class T>
inline void sum_taps_of_run(const std::vector<T>& taps, const T* first, std::size_t step, bool adds, std::size_t count,
                            T* out) {
  constexpr std::size_t width = kRegisterLanes<T>;
  std::size_t i = 0;
  for (; i + 8 * width <= count; i += 8 * width) sum_taps<1, 8>(taps, first + i, step, adds, out + i, 0);
  for (; i + width <= count; i += width) sum_taps<1, 1>(taps, first + i, step, adds, out + i, 0);
  for (; i < count; ++i) {
    T sum = adds ? out[i] : T(0);
    const T* from = first + i;
    for (const T tap : taps) sum += tap * *from, from -= step;
    out[i] = sum;
  }
}

template <class T>
bool is_all_zero(const T* values, std::size_t count) {
  std::size_t others = 0;  // counted, not searched: a search has an exit for each value and does not run in lanes
#pragma omp simd reduction(+ : others)
  for (std::size_t i = 0; i < count; ++i) others += values[i] != T(0);
  return others == 0;
}

/// convolve_axis, tap by tap. A line along x is summed where it lies, between zeros as wide as the taps reach. Along
/// other axes neighbouring lines form strips that the nearest cache holds; they are copied there once, since rows that
/// are a power of two apart would drive each other out, and sums go straight to `out`. What is 0 is passed over.
template <int Dim, class T>
void convolve_axis_directly(const Lattice<Dim>& lattice, int channels, int axis, const std::vector<T>& taps,
                            Combine combine, const T* in, T* out) {
  constexpr std::size_t lanes = 256 / sizeof(T);
  // Eight sums at a time, in two rows where the registers suffice for the values as well.
  constexpr int kRows = kRegisterBytes == 64 ? 2 : 1, kRegisters = 8 / kRows;
  const std::size_t radius = taps.size() / 2, count = static_cast<std::size_t>(lattice.size[axis]);
  std::size_t inner = static_cast<std::size_t>(channels), outer = 1;
  for (int a = 0; a < axis; ++a) inner *= static_cast<std::size_t>(lattice.size[a]);
  for (int a = axis + 1; a < Dim; ++a) outer *= static_cast<std::size_t>(lattice.size[a]);
  const std::size_t slab = inner * count;
  const bool adds = combine == Combine::Add;
  const bool in_parallel = is_worth_threads(lattice.sites());
  if (axis == 0) {
#pragma omp parallel if (in_parallel)
    {
      const std::size_t margin = radius * inner;
      LineVector<T> line(slab + 2 * margin, T(0));
#pragma omp for schedule(static)
      for (std::size_t l = 0; l < outer; ++l) {
        if (is_all_zero(in + l * slab, slab)) {
          if (!adds) std::fill_n(out + l * slab, slab, T(0));
          continue;
        }
        std::copy_n(in + l * slab, slab, line.data() + margin);
        sum_taps_of_run(taps, line.data() + 2 * margin, inner, adds, slab, out + l * slab);
      }
    }
    return;
  }
  const std::size_t strips_a_slab = (inner + lanes - 1) / lanes;
#pragma omp parallel if (in_parallel)
  {
    LineVector<T> strip((count + 2 * radius) * lanes, T(0));
    T* rows = strip.data() + radius * lanes;
#pragma omp for schedule(static)
    for (std::size_t s = 0; s < outer * strips_a_slab; ++s) {
      const std::size_t at = s / strips_a_slab * slab + s % strips_a_slab * lanes;
      const std::size_t width = std::min(lanes, inner - s % strips_a_slab * lanes);
      for (std::size_t row = 0; row < count; ++row) {
        if (width == lanes)
          std::memcpy(rows + row * lanes, in + at + row * inner, lanes * sizeof(T));
        else
          std::copy_n(in + at + row * inner, width, rows + row * lanes);
      }
      std::size_t first = 0, last = count;
      while (first < last && is_all_zero(rows + first * lanes, width)) ++first;
      while (last > first && is_all_zero(rows + (last - 1) * lanes, width)) --last;
      const std::size_t begin = first < last ? first - std::min(first, radius) : 0;
      const std::size_t end = first < last ? std::min(count, last + radius) : 0;
      std::size_t row = begin;
      if (width == lanes)
        for (; row + kRows <= end; row += kRows)
          for (std::size_t i = 0; i < lanes; i += kRegisters * kRegisterLanes<T>)
            sum_taps<kRows, kRegisters>(taps, rows + (row + radius) * lanes + i, lanes, adds,
                                        out + at + row * inner + i, inner);
      for (; row < end; ++row)
        sum_taps_of_run(taps, rows + (row + radius) * lanes, lanes, adds, width, out + at + row * inner);
      if (adds) continue;
      for (std::size_t other = 0; other < count; ++other)
        if (other < begin || other >= end) std::fill_n(out + at + other * inner, width, T(0));
    }
  }
}

}  // namespace saltus
