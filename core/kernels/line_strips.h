#pragma once

#include "core/grid/lattice.h"
#include "core/kernels/separable_convolution.h"
#include "core/support/thread_count.h"

#include <algorithm>
#include <cstring>

namespace saltus {

/// Values side by side in a strip of lines: two cache lines.
template <class T>
constexpr int kLanes = 128 / sizeof(T);

/// Where the lines of one strip lie in a field: `count` rows, `row_stride` scalars apart, each made of `width` scalars
/// in pieces of `piece` neighbours that are `piece_stride` apart.
struct StripPlace {
  int count = 0, width = 0, piece = 0;
  std::size_t row_stride = 0, piece_stride = 0;

  template <class T>
  void read(const T* field, T* strip) const {
    each_piece([&](std::size_t row, int k, std::size_t at, int length) {
      std::copy_n(field + at, length, strip + row * kLanes<T> + k);
    });
  }
  template <class T>
  void write(const T* strip, T* field) const {
    each_piece([&](std::size_t row, int k, std::size_t at, int length) {
      std::copy_n(strip + row * kLanes<T> + k, length, field + at);
    });
  }

 private:
  /// copy(row, lane, place in the field, scalars), with a constant number of scalars for short pieces and for whole
  /// rows.
  template <class Copy>
  void each_piece(Copy&& copy) const {
    if (piece == 2) return walk(copy, std::integral_constant<int, 2>());
    if (piece == 3) return walk(copy, std::integral_constant<int, 3>());
    if (piece == kLanes<float>) return walk(copy, std::integral_constant<int, kLanes<float>>());
    walk(copy, piece);
  }
  template <class Copy, class Length>
  void walk(Copy&& copy, Length length) const {
    for (int row = 0; row < count; ++row)
      for (int k = 0, p = 0; k < width; k += length, ++p)
        copy(static_cast<std::size_t>(row), k, static_cast<std::size_t>(row) * row_stride + p * piece_stride, length);
  }
};

/// Calls convolve(count, source, target) for strips of lines along `axis`, which together are the whole field: `count`
/// rows of kLanes values each, copied out of `in` (lanes beyond the last line hold 0). It adds to `target`,
/// which starts from 0 or, with Combine::Add, from `out`, where it goes to. A strip belongs to one thread.
///
/// Fields that are 0 nearly everywhere cost little: only the rows from the first to the last that is not 0, and
/// `radius` more on either side, are convolved; the others have nothing to receive. In a dense field that takes two
/// looks.
template <int Dim, class T, class Convolve>
void for_line_strips(const Lattice<Dim>& lattice, int channels, int axis, int radius, Combine combine, const T* in,
                     T* out, Convolve&& convolve) {
  const int count = lattice.size[axis];
  std::size_t inner = static_cast<std::size_t>(channels), outer = 1;
  for (int a = 0; a < axis; ++a) inner *= static_cast<std::size_t>(lattice.size[a]);
  for (int a = axis + 1; a < Dim; ++a) outer *= static_cast<std::size_t>(lattice.size[a]);
  // Along x the lanes of a strip are the channels of neighbouring lines, along other axes neighbouring values.
  const std::size_t slab = inner * static_cast<std::size_t>(count);
  const std::size_t lines_a_strip = static_cast<std::size_t>(std::max(1, kLanes<T> / channels));
  const std::size_t strips_a_slab = (inner + kLanes<T> - 1) / kLanes<T>;
  const std::size_t strips = axis == 0 ? (outer + lines_a_strip - 1) / lines_a_strip : outer * strips_a_slab;
  const int widest = axis == 0 ? static_cast<int>(lines_a_strip) * channels : kLanes<T>;
#pragma omp parallel if (is_worth_threads(lattice.sites()))
  {
    std::vector<T> source(static_cast<std::size_t>(count) * kLanes<T>), target(source.size());
#pragma omp for schedule(static)
    for (std::size_t s = 0; s < strips; ++s) {
      std::size_t at;
      StripPlace place;
      place.count = count;
      place.row_stride = inner;
      if (axis == 0) {
        const std::size_t lines = std::min(lines_a_strip, outer - s * lines_a_strip);
        at = s * lines_a_strip * slab;
        place.width = static_cast<int>(lines) * channels;
        place.piece = channels;
        place.piece_stride = slab;
      } else {
        const std::size_t first = s % strips_a_slab * kLanes<T>;
        at = s / strips_a_slab * slab + first;
        place.width = place.piece = static_cast<int>(std::min<std::size_t>(kLanes<T>, inner - first));
      }
      if (place.width < widest) std::fill(source.begin(), source.end(), T(0));  // unused lanes are 0
      place.read(in + at, source.data());
      // The next strip of the slab is 128 bytes further in every row, too far apart for the machine to foresee.
      if (axis > 0 && (s + 1) % strips_a_slab != 0)
        for (int row = 0; row < count; ++row) {
          const std::size_t next = at + kLanes<T> + static_cast<std::size_t>(row) * inner;
          for (int line = 0; line < kLanes<T>; line += kLanes<T> / 2) {
            __builtin_prefetch(in + next + line);
            __builtin_prefetch(out + next + line, 1);
          }
        }
      const auto is_zero = [&](int row) {
        const T* values = source.data() + row * kLanes<T>;
        int others = 0;  // counted, not searched: a search has an exit for each value and does not run in lanes
#pragma omp simd reduction(+ : others)
        for (int lane = 0; lane < kLanes<T>; ++lane) others += values[lane] != T(0);
        return others == 0;
      };
      int first = 0, last = count - 1;
      while (first < count && is_zero(first)) ++first;
      while (last > first && is_zero(last)) --last;
      const int begin = std::max(0, first - radius), end = first < count ? std::min(count, last + 1 + radius) : begin;
      if (combine == Combine::Add) {
        place.count = end - begin;
        at += static_cast<std::size_t>(begin) * inner;
        place.read(out + at, target.data() + begin * kLanes<T>);
      } else {
        std::fill(target.begin(), target.end(), T(0));
      }
      if (begin < end) convolve(end - begin, source.data() + begin * kLanes<T>, target.data() + begin * kLanes<T>);
      place.write(target.data() + (combine == Combine::Add ? begin * kLanes<T> : 0), out + at);
    }
  }
}

/// Rows i to i + Rows - 1 of add_taps, all of whose sources are there (or, with `is_cut`, may not be). The sums stay in
/// registers: an array of single values that is this long would not.
template <int Lanes, int Rows, bool is_cut, class T, class Taps>
[[gnu::always_inline]] inline void add_taps_to_rows(const Taps& taps, int i, int count, const T* source, T* target) {
  typedef T Vector __attribute__((vector_size(32)));
  constexpr int width = sizeof(Vector) / sizeof(T), vectors = Rows * Lanes / width;
  static_assert(Lanes % width == 0);
  Vector sum[vectors];
  T* out = target + i * Lanes;
#pragma GCC unroll 16
  for (int v = 0; v < vectors; ++v) std::memcpy(&sum[v], out + v * width, sizeof(Vector));
  for (const auto& [t, tap] : taps) {
    if (is_cut && (i - t < 0 || i - t >= count)) continue;
    const T* row = source + (i - t) * Lanes;
#pragma GCC unroll 16
    for (int v = 0; v < vectors; ++v) {
      Vector values;
      std::memcpy(&values, row + v * width, sizeof(Vector));
      sum[v] += tap * values;
    }
  }
#pragma GCC unroll 16
  for (int v = 0; v < vectors; ++v) std::memcpy(out + v * width, &sum[v], sizeof(Vector));
}

/// target row i += sum over (t, tap) of tap * source row i - t, over rows of `Lanes` values. Two rows at a time, so
/// that no sum waits for the one before; each is made in the order of the taps.
template <int Lanes, class T, class Taps>
inline void add_taps(const Taps& taps, int count, const T* source, T* target) {
  int least = 0, most = 0;  // t
  for (const auto& [t, tap] : taps) least = std::min(least, t), most = std::max(most, t);
  int i = 0;
  for (; i < std::min(most, count); ++i) add_taps_to_rows<Lanes, 1, true>(taps, i, count, source, target);
  for (; i + 1 < count + least; i += 2) add_taps_to_rows<Lanes, 2, false>(taps, i, count, source, target);
  for (; i < count; ++i) add_taps_to_rows<Lanes, 1, true>(taps, i, count, source, target);
}

}  // namespace saltus
