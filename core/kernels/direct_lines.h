#pragma once

#include "core/kernels/mirrored_sums.h"
#include "core/kernels/shifted_sums.h"
#include "core/kernels/transpose.h"
#include "core/support/line_vector.h"
#include "core/support/registers.h"

#include <algorithm>
#include <atomic>
#include <cstdint>
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

/// A field of more bytes than this has left the caches by the time it is read again.
constexpr std::size_t kFarBytes = 4 << 20;

/// Of what is left of `all` from `first` on, at most `most`.
inline std::size_t at_most(std::size_t most, std::size_t all, std::size_t first) { return std::min(most, all - first); }

/// Writes values, or adds them to what is there.
template <class T>
void put(const T* values, std::size_t count, bool adds, T* to) {
  if (!adds) return void(std::copy_n(values, count, to));
  for (std::size_t k = 0; k < count; ++k) to[k] += values[k];
}

/// What a thread works with along x, for any number of groups of lines: a column's values, between zeros as far as taps
/// reach before it, and after it from where blocks of rows may end; sums; and a tile of what fills no register.
template <class T>
struct LineScratch {
  LineScratch(std::size_t sites, std::size_t channels, std::size_t reach)
      : column((2 * reach + sites + kRegisterLanes<T>)*channels * kRegisterLanes<T>, T(0)),
        sums(channels * kRegisterLanes<T> * kRegisterLanes<T>),
        tile(kRegisterLanes<T> * kRegisterLanes<T>),
        values(column.data() + reach * channels * kRegisterLanes<T>) {}
  LineScratch(const LineScratch&) = delete;
  LineScratch& operator=(const LineScratch&) = delete;

  LineVector<T> column, sums, tile;
  T* values;
};

/// Lines along x, and groups of as many of them as a register has lanes.
struct Lines {
  std::size_t lines, sites, channels;
  template <class T>
  std::size_t groups() const {
    return (lines + kRegisterLanes<T> - 1) / kRegisterLanes<T>;
  }
};

/// What is fetched into the second cache while a group is summed: so many lines at once are foreseen by no machine.
/// Null: nothing.
template <class T>
struct Soon {
  std::size_t lines = 0;
  const T *read = nullptr, *written = nullptr;
};

/// A row of taps applied along x, where the values that meet lie side by side: line by line where sum_shifted can; else
/// as many lines as a register has lanes are turned, so that each fills one lane of a column of registers, summed down
/// that column, and turned back, while what comes `soon` is fetched, which gains nothing line by line. Lines that are 0
/// are passed over. One group of them; `out` may be `in`.
template <class T>
void convolve_line_group(const Lines& all, std::size_t group, const MirroredTaps<T>& taps, bool adds, const T* in,
                         T* out, const Soon<T>& soon, LineScratch<T>& scratch) {
  constexpr std::size_t lanes = kRegisterLanes<T>;
  const std::size_t sites = all.sites, channels = all.channels;
  const std::size_t length = sites * channels;  // of a line
  const std::size_t step = channels * lanes;    // from a site to the next one in a column
  const std::size_t some = at_most(lanes, all.lines, group * lanes);
  const T* from = in + group * lanes * length;
  T* to = out + group * lanes * length;
  T *values = scratch.values, *tile = scratch.tile.data();
  if (is_all_zero(from, some * length)) {
    if (!adds) std::fill_n(to, some * length, T(0));
    return;
  }
  if (can_shift(taps, channels)) return sum_shifted<T>(taps, {some, channels, length, from, to, adds});
  for (std::size_t i = 0; i < length; i += lanes) {
    const std::size_t width = at_most(lanes, length, i);
    if (some == lanes && width == lanes) {
      transpose_tile(from + i, length, false, values + i * lanes, lanes);
      continue;
    }
    std::fill_n(tile, lanes * lanes, T(0));
    for (std::size_t line = 0; line < some; ++line) std::copy_n(from + line * length + i, width, tile + line * lanes);
    transpose_tile<T>(tile, lanes, false, values + i * lanes, lanes);
  }
  for (std::size_t x = 0; x < sites; x += lanes) {
    for (std::size_t line = 0; line < soon.lines; ++line)
      for (std::size_t i = x * channels; i < std::min(length, (x + lanes) * channels); i += 64 / sizeof(T)) {
        if (soon.read) __builtin_prefetch(soon.read + line * length + i, 0, 2);
        if (soon.written) __builtin_prefetch(soon.written + line * length + i, 1, 2);
      }
    sum_mirrored<T>(taps,
                    {static_cast<int>(lanes) / kRowsAtOnce, static_cast<int>(channels), values + x * step,
                     static_cast<std::ptrdiff_t>(step), scratch.sums.data(), static_cast<std::ptrdiff_t>(step), false});
    for (std::size_t i = x * channels; i < std::min(length, (x + lanes) * channels); i += lanes) {
      const T* turned = scratch.sums.data() + (i - x * channels) * lanes;
      const std::size_t width = at_most(lanes, length, i);
      if (some == lanes && width == lanes) {
        transpose_tile(turned, lanes, adds, to + i, length);
        continue;
      }
      transpose_tile(turned, lanes, false, tile, lanes);
      for (std::size_t line = 0; line < some; ++line) put(tile + line * lanes, width, adds, to + line * length + i);
    }
  }
}

/// All groups.
template <class T>
void convolve_lines(const Lines& all, const MirroredTaps<T>& taps, bool adds, bool in_parallel, const T* in, T* out) {
#pragma omp parallel if (in_parallel)
  {
    LineScratch<T> scratch(all.sites, all.channels, taps.reach());
#pragma omp for schedule(static)
    for (std::size_t group = 0; group < all.groups<T>(); ++group) {
      const std::size_t next = (group + 1) * kRegisterLanes<T>;  // line
      Soon<T> soon;
      if (next < all.lines)
        soon = {at_most(kRegisterLanes<T>, all.lines, next), in + next * all.sites * all.channels,
                out + next * all.sites * all.channels};
      convolve_line_group(all, group, taps, adds, in, out, soon, scratch);
    }
  }
}

/// Lanes of a strip of lines along another axis than x.
template <class T>
constexpr std::size_t kStripLanes = kStripStep<T>;
/// Lanes of it that are summed from end to end before the next ones are. All lanes of the rows that 45 taps reach are
/// 24 KB (with eight rows at once 26), too much of a nearest cache of 32 beside what comes and goes.
template <class T>
constexpr std::size_t kPartLanes = kStripLanes<T> / 2;

/// What a thread works with along another axis, for any number of strips: the strip's rows, between zeros as far as
/// taps reach, and sums.
template <class T>
struct StripScratch {
  StripScratch(std::size_t count, std::size_t reach)
      : strip((count + 2 * reach + kRowsAtOnce) * kStripLanes<T>, T(0)),
        sums(kRowsAtOnce * kStripLanes<T>),
        rows(strip.data() + reach * kStripLanes<T>) {}
  StripScratch(const StripScratch&) = delete;
  StripScratch& operator=(const StripScratch&) = delete;

  LineVector<T> strip, sums;
  T* rows;
};

/// Slabs of `count` rows with `inner` values side by side, and strips of neighbouring lines across the rows.
struct Strips {
  std::size_t outer, count, inner;
  template <class T>
  std::size_t of_slab() const {
    return (inner + kStripLanes<T> - 1) / kStripLanes<T>;
  }
  template <class T>
  std::size_t all() const {
    return outer * of_slab<T>();
  }
  template <class T>
  std::size_t width(std::size_t strip) const {
    return at_most(kStripLanes<T>, inner, strip % of_slab<T>() * kStripLanes<T>);
  }
  /// Where a strip begins.
  template <class T>
  std::size_t offset(std::size_t strip) const {
    return strip / of_slab<T>() * count * inner + strip % of_slab<T>() * kStripLanes<T>;
  }
};

/// The same along another axis, whose lines are `inner` apart from value to value and side by side.
/// Neighbouring lines form strips that the second cache holds; they are copied there once, since rows that are a power
/// of two apart would drive each other out, and sums go straight to `out`, past the caches if it `is_far`. What is 0 at
/// their ends is passed over. One strip; `out` may be `in`.
template <class T>
void convolve_strip(const Strips& all, std::size_t number, const MirroredTaps<T>& taps, bool adds, bool is_far,
                    const T* in, T* out, StripScratch<T>& scratch) {
  constexpr std::size_t lanes = kStripLanes<T>, register_lanes = kRegisterLanes<T>, block = kRowsAtOnce;
  const std::size_t reach = taps.reach(), count = all.count, inner = all.inner;
  const std::size_t width = all.width<T>(number);
  const T* from = in + all.offset<T>(number);
  T* to = out + all.offset<T>(number);
  T* rows = scratch.rows;
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
  T* sums = scratch.sums.data();
  // What is read anyhow is better written where it then lies.
  const bool passes_caches = is_far && !adds && in != out && inner % register_lanes == 0 &&
                             reinterpret_cast<std::uintptr_t>(to) % kRegisterBytes == 0;
  // What the next strip reads is fetched meanwhile, as many rows at a time as make them all: no machine foresees rows
  // that are so far apart.
  const bool is_last = number + 1 == all.all<T>();
  const T* soon = in + (is_last ? 0 : all.offset<T>(number + 1));
  const std::size_t next_width = is_last ? 0 : all.width<T>(number + 1);
  std::size_t left = is_last ? 0 : count;
  const std::size_t parts = (wide + kPartLanes<T> - 1) / kPartLanes<T>, blocks = whole / block * parts;
  const std::size_t at_once = blocks > 0 ? (count + blocks - 1) / blocks : 0;
  for (std::size_t first_lane = 0; first_lane < wide; first_lane += kPartLanes<T>)
    for (std::size_t row = begin; row < begin + whole; row += block) {
      for (std::size_t k = std::min(at_once, left); k-- > 0; --left, soon += inner)
        for (std::size_t i = 0; i < next_width; i += 64 / sizeof(T)) __builtin_prefetch(soon + i, 0, 2);
      const std::size_t some = at_most(kPartLanes<T>, wide, first_lane);
      const auto registers = static_cast<int>(some / register_lanes);
      const T* values = rows + row * lanes + first_lane;
      T* where = to + row * inner + first_lane;
      if (!passes_caches) {
        sum_mirrored<T>(taps, {1, registers, values, step, where, static_cast<std::ptrdiff_t>(inner), adds});
        continue;
      }
      sum_mirrored<T>(taps, {1, registers, values, step, sums, step, false});
      for (std::size_t r = 0; r < block; ++r)
        for (std::size_t i = 0; i < some; i += register_lanes)
          store_far<T>(load(sums + r * lanes + i), where + r * inner + i);
    }
  if (passes_caches) std::atomic_thread_fence(std::memory_order_seq_cst);
  for (std::size_t row = begin; row < end; row += block) {
    const std::size_t done = row < begin + whole ? wide : 0,
                      registers = (width - done + register_lanes - 1) / register_lanes;
    if (registers == 0) continue;
    sum_mirrored<T>(taps, {1, static_cast<int>(registers), rows + row * lanes + done, step, sums, step, false});
    for (std::size_t r = 0; r < at_most(block, end, row); ++r)
      put(sums + r * lanes, width - done, adds, to + (row + r) * inner + done);
  }
  if (adds) return;
  for (std::size_t other = 0; other < count; ++other)
    if (other < begin || other >= end) std::fill_n(to + other * inner, width, T(0));
}

/// All strips.
template <class T>
void convolve_strips(const Strips& all, const MirroredTaps<T>& taps, bool adds, bool in_parallel, const T* in, T* out) {
#pragma omp parallel if (in_parallel)
  {
    StripScratch<T> scratch(all.count, taps.reach());
    const bool is_far = all.outer * all.count * all.inner * sizeof(T) > kFarBytes;
#pragma omp for schedule(static)
    for (std::size_t strip = 0; strip < all.all<T>(); ++strip)
      convolve_strip(all, strip, taps, adds, is_far, in, out, scratch);
  }
}

}  // namespace saltus
