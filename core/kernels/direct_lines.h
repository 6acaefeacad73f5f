#pragma once

#include "core/grid/lattice.h"
#include "core/kernels/separable_convolution.h"
#include "core/support/line_vector.h"
#include "core/support/registers.h"
#include "core/support/thread_count.h"

#include <algorithm>
#include <cstring>
#include <utility>
#include <vector>

namespace saltus {

/// visit(0), ..., visit(Count - 1), as constants.
template <int Count, class Visit>
[[gnu::always_inline]] inline void unrolled(Visit&& visit) {
  [&]<int... i>(std::integer_sequence<int, i...>) { (visit(std::integral_constant<int, i>()), ...); }
  (std::make_integer_sequence<int, Count>());
}

/// out (+)= sum over taps of tap * value, for `Blocks` blocks of `Registers` registers of neighbouring values, which
/// are out_step apart. The value of the first tap stands for block 0 at `first`, for each next tap one `step` before,
/// for each next block `Apart` steps after: blocks share what they read. Sums are made in the order of the taps, all of
/// them at once, so that none waits for another. There are at least (Blocks - 1) * Apart taps.
template <int Blocks, int Registers, int Apart, class T>
[[gnu::always_inline]] inline void sum_taps(const std::vector<T>& taps, const T* first, std::size_t step, bool adds,
                                            T* out, std::size_t out_step) {
  constexpr std::size_t lanes = kRegisterLanes<T>;
  constexpr int last = (Blocks - 1) * Apart;
  const int count = static_cast<int>(taps.size());
  Register<T> sum[Blocks][Registers] = {};
  if (adds)
    unrolled<Blocks>(
        [&](auto b) { unrolled<Registers>([&](auto v) { sum[b][v] = load(out + b * out_step + v * lanes); }); });
  // Block b takes tap k - (Blocks - 1 - b) * Apart of the values at hand, so the last block begins and ends first.
  const auto take = [&](int from, int to, auto low, auto high) {
    for (int k = from; k < to; ++k) {
      const T* values = first + static_cast<std::ptrdiff_t>(last - k) * static_cast<std::ptrdiff_t>(step);
      Register<T> at_hand[Registers];
      unrolled<Registers>([&](auto v) { at_hand[v] = load(values + v * lanes); });
      unrolled<high - low>([&](auto i) {
        constexpr int b = low + i;
        const T factor = taps[static_cast<std::size_t>(k - (Blocks - 1 - b) * Apart)];
        unrolled<Registers>([&](auto v) { sum[b][v] += factor * at_hand[v]; });
      });
    }
  };
  using std::integral_constant;
  unrolled<Blocks - 1>([&](auto j) {
    take(j * Apart, (j + 1) * Apart, integral_constant<int, Blocks - 1 - j>(), integral_constant<int, Blocks>());
  });
  take(last, count, integral_constant<int, 0>(), integral_constant<int, Blocks>());
  unrolled<Blocks - 1>([&](auto j) {
    take(count + j * Apart, count + (j + 1) * Apart, integral_constant<int, 0>(),
         integral_constant<int, Blocks - 1 - j>());
  });
  unrolled<Blocks>(
      [&](auto b) { unrolled<Registers>([&](auto v) { store(sum[b][v], out + b * out_step + v * lanes); }); });
}

/// The same where only `count` values of each block may be touched in `out`.
template <int Blocks, int Registers, int Apart, class T>
inline void sum_taps_of_some(const std::vector<T>& taps, const T* first, std::size_t step, bool adds, std::size_t count,
                             T* out, std::size_t out_step) {
  constexpr std::size_t width = Registers * kRegisterLanes<T>;
  if (count == width) return sum_taps<Blocks, Registers, Apart>(taps, first, step, adds, out, out_step);
  alignas(64) T sums[Blocks * width] = {};
  if (adds)
    for (std::size_t b = 0; b < Blocks; ++b) std::copy_n(out + b * out_step, count, sums + b * width);
  sum_taps<Blocks, Registers, Apart>(taps, first, step, adds, sums, width);
  for (std::size_t b = 0; b < Blocks; ++b) std::copy_n(sums + b * width, count, out + b * out_step);
}

/// visit(how many registers hold so many values), as a constant from 1 to Most.
template <int Most, class T, class Visit>
[[gnu::always_inline]] inline void with_registers(std::size_t values, Visit&& visit) {
  const int needed = static_cast<int>((values + kRegisterLanes<T> - 1) / kRegisterLanes<T>);
  unrolled<Most>([&](auto i) {
    if (needed == i + 1) visit(std::integral_constant<int, i + 1>());
  });
}

/// Registers that are summed at once: as many as keep the processor busy while each waits for itself.
constexpr int kSums = 8;
/// Rows that share what they read; where there are half as many registers, the values would find no room in them.
constexpr int kRows = kRegisterBytes == 64 ? 2 : 1;

/// A line of `count` values, those of one site `channels` of them, between zeros as far as taps reach and registers go
/// beyond its end.
template <class T>
inline void sum_line(const std::vector<T>& taps, const T* first, std::size_t channels, bool adds, std::size_t count,
                     T* out) {
  constexpr std::size_t width = kSums * kRegisterLanes<T>;
  for (std::size_t i = 0; i < count; i += width) {
    const std::size_t some = std::min(width, count - i);
    with_registers<kSums, T>(some, [&](auto registers) {
      sum_taps_of_some<1, registers, 1>(taps, first + i, channels, adds, some, out + i, 0);
    });
  }
}

/// The same for rows of more taps than a register has lanes: a value that meets one tap here meets another as many
/// sites further on.
template <int Channels, class T>
inline void sum_line_in_blocks(const std::vector<T>& taps, const T* first, bool adds, std::size_t count, T* out) {
  constexpr int lanes = kRegisterLanes<T>, most = 3;
  constexpr std::size_t block = static_cast<std::size_t>(Channels) * lanes;
  const int blocks = 1 + static_cast<int>(taps.size()) / lanes;
  std::size_t i = 0;
  unrolled<most>([&](auto fewer) {
    constexpr int together = most - fewer;
    if (together > blocks) return;
    for (; i + together * block <= count; i += together * block)
      sum_taps<together, Channels, lanes>(taps, first + i, Channels, adds, out + i, block);
  });
  if (i < count) sum_taps_of_some<1, Channels, 1>(taps, first + i, Channels, adds, count - i, out + i, 0);
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
  constexpr std::size_t lanes = 256 / sizeof(T), beyond = kSums * kRegisterLanes<T>;
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
      LineVector<T> line(slab + 2 * margin + beyond, T(0));
#pragma omp for schedule(static)
      for (std::size_t l = 0; l < outer; ++l) {
        if (is_all_zero(in + l * slab, slab)) {
          if (!adds) std::fill_n(out + l * slab, slab, T(0));
          continue;
        }
        std::copy_n(in + l * slab, slab, line.data() + margin);
        const T* first = line.data() + 2 * margin;
        if (taps.size() > kRegisterLanes<T> && channels == 3)
          sum_line_in_blocks<3>(taps, first, adds, slab, out + l * slab);
        else if (taps.size() > kRegisterLanes<T> && channels == 2)
          sum_line_in_blocks<2>(taps, first, adds, slab, out + l * slab);
        else
          sum_line(taps, first, inner, adds, slab, out + l * slab);
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
      // The next strip is asked for while this one is summed: rows so far apart are foreseen by no machine.
      const std::size_t next = s + 1, next_in_slab = next % strips_a_slab * lanes;
      const std::size_t next_at = next / strips_a_slab * slab + next_in_slab;
      const std::size_t next_width = next < outer * strips_a_slab ? std::min(lanes, inner - next_in_slab) : 0;
      const auto ask_for = [&](std::size_t row) {
        for (std::size_t i = 0; i < next_width; i += 64 / sizeof(T)) {
          __builtin_prefetch(in + next_at + row * inner + i);
          __builtin_prefetch(out + next_at + row * inner + i, 1);
        }
      };
      const std::size_t begin = first < last ? first - std::min(first, radius) : 0;
      const std::size_t end = first < last ? std::min(count, last + radius) : 0;
      for (std::size_t i = 0; i < width; i += kSums / kRows * kRegisterLanes<T>) {
        const std::size_t some = std::min(kSums / kRows * kRegisterLanes<T>, width - i);
        with_registers<kSums / kRows, T>(some, [&](auto registers) {
          const auto sum_rows = [&](auto rows_at_once, std::size_t row) {
            sum_taps_of_some<rows_at_once, registers, 1>(taps, rows + (row + radius) * lanes + i, lanes, adds, some,
                                                         out + at + row * inner + i, inner);
          };
          std::size_t row = begin;
          for (; row + kRows <= end; row += kRows) {
            if (i == 0)
              for (std::size_t r = 0; r < kRows; ++r) ask_for(row + r);
            sum_rows(std::integral_constant<int, kRows>(), row);
          }
          for (; row < end; ++row) sum_rows(std::integral_constant<int, 1>(), row);
        });
      }
      if (adds) continue;
      for (std::size_t other = 0; other < count; ++other)
        if (other < begin || other >= end) std::fill_n(out + at + other * inner, width, T(0));
    }
  }
}

}  // namespace saltus
