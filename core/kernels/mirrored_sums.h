#pragma once

#include "core/kernels/axis_taps.h"
#include "core/support/registers.h"

#include <type_traits>
#include <utility>

namespace saltus {

/// visit(0), ..., visit(Count - 1), as constants.
template <int Count, class Visit>
[[gnu::always_inline]] inline void unrolled(Visit&& visit) {
  [&]<int... i>(std::integer_sequence<int, i...>) { (visit(std::integral_constant<int, i>()), ...); }
  (std::make_integer_sequence<int, Count>());
}

/// Rows summed at once: as many as there are registers for, with their values on either side.
constexpr int kRowsAtOnce = kRegisterBytes == 64 ? 8 : 4;

/// Steps between rows that sums are compiled for, since they are the usual ones: where a row lies is then part of what
/// reads it. Those of a strip of lines, and of a column of registers with three channels (direct_lines.h).
template <class T>
constexpr int kStripStep = 512 / sizeof(T);
template <class T>
constexpr int kColumnStep = 3 * kRegisterLanes<T>;

/// `blocks` times kRowsAtOnce rows of `registers` registers each, with a step between rows: where their own values are,
/// and where their sums go.
template <class T>
struct RowsToSum {
  int blocks, registers;
  const T* values;
  std::ptrdiff_t step;
  T* out;
  std::ptrdiff_t out_step;
  bool adds;  ///< to what is in `out`
};

/// sum_mirrored with what it is compiled for: the kind, how many of the sides are left of whole blocks of them, and the
/// step (0: any).
template <Mirror kind, int Rest, int Step, class T>
void sum_mirrored_of(const MirroredTaps<T>& taps, const RowsToSum<T>& all) {
  constexpr int rows = kRowsAtOnce, lanes = kRegisterLanes<T>;
  const std::ptrdiff_t step = Step > 0 ? Step : all.step, out_step = all.out_step;
  const T* sides = taps.sides.data();
  const int count = static_cast<int>(taps.sides.size());
  const auto slot = [](int row) constexpr { return ((row % rows) + rows) % rows; };
  for (int block = 0; block < all.blocks; ++block)
    for (int at = 0; at < all.registers; ++at) {
      const T* own = all.values + block * rows * step + at * lanes;
      T* out = all.out + block * rows * out_step + at * lanes;
      // Of the row i, side k is row i of these, k rows away. In slot r modulo the rows is what lies in row r.
      const T *low = own - taps.before * step, *high = own + taps.after * step;
      Register<T> sum[rows], before[rows], after[rows];
      unrolled<rows>([&](auto i) {
        sum[i] = kind == Mirror::Even ? taps.middle * load(own + i * step) : Register<T>{};
        if constexpr (i > 0) before[i] = load(low + i * step);
        if constexpr (i + 1 < rows) after[i] = load(high + i * step);
      });
      const auto take = [&](auto turn, int k) {  // turn is k modulo the rows
        before[slot(-turn)] = load(low - k * step);
        after[slot(rows - 1 + turn)] = load(high + (rows - 1 + k) * step);
        unrolled<rows>([&](auto i) {
          const Register<T>&left = before[slot(i - turn)], &right = after[slot(i + turn)];
          sum[i] += sides[k] * (kind == Mirror::Even ? left + right : left - right);
        });
      };
      int k = 0;
      for (; k + rows <= count; k += rows) unrolled<rows>([&](auto j) { take(j, k + j); });
      unrolled<Rest>([&](auto j) { take(j, k + j); });
      if (all.adds)
        unrolled<rows>([&](auto i) { store(load<T>(out + i * out_step) + sum[i], out + i * out_step); });
      else
        unrolled<rows>([&](auto i) { store(sum[i], out + i * out_step); });
    }
}

template <int Step, class T>
void sum_mirrored_with(const MirroredTaps<T>& taps, const RowsToSum<T>& rows) {
  const int rest = static_cast<int>(taps.sides.size()) % kRowsAtOnce;
  unrolled<kRowsAtOnce>([&](auto i) {
    if (rest != i) return;
    taps.kind == Mirror::Even ? sum_mirrored_of<Mirror::Even, i, Step>(taps, rows)
                              : sum_mirrored_of<Mirror::Odd, i, Step>(taps, rows);
  });
}

/// A row of taps applied across rows of values; there are as many rows before and after as the taps reach. Each sum is
/// made in the same order, from the middle outwards. Two values are added and then meet the tap that they share: half
/// as many products, with additions for the other half, which a processor does beside them. Values stay in registers
/// while rows pass them on to each other, so that a tap reads one value on either side for a whole block of rows.
template <class T>
void sum_mirrored(const MirroredTaps<T>& taps, const RowsToSum<T>& rows) {
  if (rows.step == kStripStep<T>)
    sum_mirrored_with<kStripStep<T>>(taps, rows);
  else if (rows.step == kColumnStep<T>)
    sum_mirrored_with<kColumnStep<T>>(taps, rows);
  else
    sum_mirrored_with<0>(taps, rows);
}

}  // namespace saltus
