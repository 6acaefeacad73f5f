#pragma once

#include "core/kernels/mirrored_sums.h"
#include "core/kernels/transpose.h"
#include "core/support/line_vector.h"
#include "core/support/registers.h"

#include <algorithm>
#include <cstring>

namespace saltus {

template <class T>
bool is_all_zero(const T* values, std::size_t count) {
  constexpr std::size_t chunk = 256 / sizeof(T);  // looked at as a whole: a search value by value does not run in lanes
  for (std::size_t i = 0; i < count; i += chunk) {
    const std::size_t end = std::min(count, i + chunk);
    int others = 0;
#pragma omp simd reduction(| : others)
    for (std::size_t k = i; k < end; ++k) others |= values[k] != T(0);
    if (others) return false;
  }
  return true;
}

/// Of what is left of `all` from `first` on, at most `most`.
inline std::size_t at_most(std::size_t most, std::size_t all, std::size_t first) { return std::min(most, all - first); }

/// Writes values, or adds them to what is there.
template <class T>
void put(const T* values, std::size_t count, bool adds, T* to) {
  if (!adds) return void(std::copy_n(values, count, to));
  for (std::size_t k = 0; k < count; ++k) to[k] += values[k];
}

/// A row of taps applied along x, where the values that meet lie side by side: as many lines as a register has lanes
/// are turned, so that each fills one lane of a column of registers, summed down that column, and turned back. Lines
/// that are 0 are passed over.
template <class T>
void convolve_lines(std::size_t lines, std::size_t sites, std::size_t channels, const MirroredTaps<T>& taps, bool adds,
                    bool in_parallel, const T* in, T* out) {
  constexpr std::size_t lanes = kRegisterLanes<T>;
  const std::size_t length = sites * channels;  // of a line
  const std::size_t margin = taps.reach() * channels * lanes;
  const std::size_t step = channels * lanes;  // from a site to the next one in a column
  const std::size_t groups = (lines + lanes - 1) / lanes;
#pragma omp parallel if (in_parallel)
  {
    // A column's values, with zeros as far as taps reach before it, and after it from where blocks of rows may end.
    LineVector<T> column(2 * margin + (sites + lanes) * step, T(0));
    LineVector<T> sums(lanes * step), tile(lanes * lanes);
    T* values = column.data() + margin;
#pragma omp for schedule(static)
    for (std::size_t group = 0; group < groups; ++group) {
      const std::size_t some = at_most(lanes, lines, group * lanes);  // lines
      const T* from = in + group * lanes * length;
      T* to = out + group * lanes * length;
      if (is_all_zero(from, some * length)) {
        if (!adds) std::fill_n(to, some * length, T(0));
        continue;
      }
      for (std::size_t i = 0; i < length; i += lanes) {
        const std::size_t width = at_most(lanes, length, i);
        if (some == lanes && width == lanes) {
          transpose_tile(from + i, length, false, values + i * lanes, lanes);
          continue;
        }
        std::fill(tile.begin(), tile.end(), T(0));
        for (std::size_t line = 0; line < some; ++line)
          std::copy_n(from + line * length + i, width, tile.data() + line * lanes);
        transpose_tile(tile.data(), lanes, false, values + i * lanes, lanes);
      }
      const std::size_t next_some = group + 1 < groups ? at_most(lanes, lines, (group + 1) * lanes) : 0;
      for (std::size_t x = 0; x < sites; x += lanes) {
        // The next lines are asked for while these are summed: so many at once are foreseen by no machine.
        for (std::size_t line = 0; line < next_some; ++line)
          for (std::size_t i = x * channels; i < std::min(length, (x + lanes) * channels); i += 64 / sizeof(T)) {
            __builtin_prefetch(from + (lanes + line) * length + i, 0, 2);
            __builtin_prefetch(to + (lanes + line) * length + i, 1, 2);
          }
        sum_mirrored<T>(taps,
                        {static_cast<int>(lanes) / kRowsAtOnce, static_cast<int>(channels), values + x * step,
                         static_cast<std::ptrdiff_t>(step), sums.data(), static_cast<std::ptrdiff_t>(step), false});
        for (std::size_t i = x * channels; i < std::min(length, (x + lanes) * channels); i += lanes) {
          const T* turned = sums.data() + (i - x * channels) * lanes;
          const std::size_t width = at_most(lanes, length, i);
          if (some == lanes && width == lanes) {
            transpose_tile(turned, lanes, adds, to + i, length);
            continue;
          }
          transpose_tile(turned, lanes, false, tile.data(), lanes);
          for (std::size_t line = 0; line < some; ++line)
            put(tile.data() + line * lanes, width, adds, to + line * length + i);
        }
      }
    }
  }
}

/// The same along another axis, whose lines are `inner` apart from value to value and side by side.
/// Neighbouring lines form strips that the second cache holds; they are copied there once, since rows that are a power
/// of two apart would drive each other out, and sums go straight to `out`. What is 0 at their ends is passed over.
template <class T>
void convolve_strips(std::size_t outer, std::size_t count, std::size_t inner, const MirroredTaps<T>& taps, bool adds,
                     bool in_parallel, const T* in, T* out) {
  constexpr std::size_t lanes = 512 / sizeof(T), register_lanes = kRegisterLanes<T>, block = kRowsAtOnce;
  const std::size_t reach = taps.reach(), slab = inner * count;
  const std::size_t strips_a_slab = (inner + lanes - 1) / lanes;
#pragma omp parallel if (in_parallel)
  {
    LineVector<T> strip((count + 2 * reach + block) * lanes, T(0));
    LineVector<T> sums(block * lanes);
    T* rows = strip.data() + reach * lanes;
#pragma omp for schedule(static)
    for (std::size_t s = 0; s < outer * strips_a_slab; ++s) {
      const std::size_t at = s / strips_a_slab * slab + s % strips_a_slab * lanes;
      const std::size_t width = at_most(lanes, inner, s % strips_a_slab * lanes);
      const T* from = in + at;
      T* to = out + at;
      for (std::size_t row = 0; row < count; ++row) {
        if (width == lanes)
          std::memcpy(rows + row * lanes, from + row * inner, lanes * sizeof(T));
        else
          std::copy_n(from + row * inner, width, rows + row * lanes);
      }
      std::size_t first = 0, last = count;
      while (first < last && is_all_zero(rows + first * lanes, width)) ++first;
      while (last > first && is_all_zero(rows + (last - 1) * lanes, width)) --last;
      const std::size_t begin = first < last ? first - std::min(first, reach) : 0;
      const std::size_t end = first < last ? std::min(count, last + reach) : 0;
      // Whole registers of whole blocks go where they belong, others by way of `sums`.
      const std::size_t whole = (end - begin) / block * block, wide = width / register_lanes * register_lanes;
      const auto step = static_cast<std::ptrdiff_t>(lanes);
      sum_mirrored<T>(taps, {static_cast<int>(whole / block), static_cast<int>(wide / register_lanes),
                             rows + begin * lanes, step, to + begin * inner, static_cast<std::ptrdiff_t>(inner), adds});
      for (std::size_t row = begin; row < end; row += block) {
        const std::size_t done = row < begin + whole ? wide : 0,
                          registers = (width - done + register_lanes - 1) / register_lanes;
        if (registers == 0) continue;
        sum_mirrored<T>(taps,
                        {1, static_cast<int>(registers), rows + row * lanes + done, step, sums.data(), step, false});
        for (std::size_t r = 0; r < at_most(block, end, row); ++r)
          put(sums.data() + r * lanes, width - done, adds, to + (row + r) * inner + done);
      }
      if (adds) continue;
      for (std::size_t other = 0; other < count; ++other)
        if (other < begin || other >= end) std::fill_n(to + other * inner, width, T(0));
    }
  }
}

}  // namespace saltus
