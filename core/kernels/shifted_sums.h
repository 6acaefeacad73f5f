#pragma once

#include "core/kernels/mirrored_sums.h"
#include "core/support/registers.h"

#include <cstddef>
#include <type_traits>

namespace saltus {

/// Lines of `length` values that follow each other, all channels of a site side by side, and where their sums go, which
/// may be where they are.
template <class T>
struct LinesToSum {
  std::size_t lines, channels, length;
  const T* values;
  T* out;
  bool adds;  ///< to what is in `out`
};

/// Most sides that sums of shifted lines are compiled for: what they keep finds room in the registers.
constexpr int kMostShiftedSides = kRegisterBytes == 64 ? 10 : 7;

/// Whether sum_shifted can do it; else lines are turned, so that what meets lies in one lane (direct_lines.h).
template <class T>
bool can_shift(const MirroredTaps<T>& taps, std::size_t channels) {
  return (channels == 2 || channels == 3) && taps.kind == Mirror::Even && taps.before == 1 && taps.after == 1 &&
         !taps.sides.empty() && taps.sides.size() <= kMostShiftedSides;
}

template <int Channels, int Sides, class T>
void sum_shifted_of(const MirroredTaps<T>& taps, const LinesToSum<T>& all) {
  constexpr int lanes = static_cast<int>(kRegisterLanes<T>), aside = (Channels * Sides - 1) / lanes + 1;
  const T middle = taps.middle, *sides = taps.sides.data();
  const std::size_t length = all.length;
  for (std::size_t line = 0; line < all.lines; ++line) {
    const T* values = all.values + line * length;
    T* out = all.out + line * length;
    const auto value = [&](std::size_t x) {
      if (x + lanes <= length) return load(values + x);
      return x < length ? load_first(length - x, values + x, T(0)) : Register<T>{};
    };
    Register<T> near[2 * aside + 1];  // the one in the middle is that of the sums
    unrolled<aside>([&](auto i) {
      near[i + 1] = Register<T>{};
      near[aside + i + 1] = value(i * lanes);
    });
    for (std::size_t x = 0; x < length; x += lanes) {
      unrolled<2 * aside>([&](auto i) { near[i] = near[i + 1]; });
      near[2 * aside] = value(x + aside * lanes);
      const auto from = [&](auto lane) {
        constexpr int whole = lane / lanes, rest = lane % lanes;
        return shifted<rest, T>(near[whole], near[rest > 0 ? whole + 1 : whole]);
      };
      Register<T> sum = middle * near[aside];
      unrolled<Sides>([&](auto k) {
        constexpr int away = Channels * (k + 1);
        sum += sides[k] * (from(std::integral_constant<int, aside * lanes - away>()) +
                           from(std::integral_constant<int, aside * lanes + away>()));
      });
      if (x + lanes <= length)
        store<T>(all.adds ? sum + load(out + x) : sum, out + x);
      else
        store_first<T>(length - x, all.adds ? sum + load_first(length - x, out + x, T(0)) : sum, out + x);
    }
  }
}

/// A row of taps applied along lines of values. The registers that a sum needs are kept, and what lies between two of
/// them is shifted out: no value is read twice, and none is written before it has been read. Sums are made in the order
/// of sum_mirrored, but a compiler may join other products with additions.
template <class T>
void sum_shifted(const MirroredTaps<T>& taps, const LinesToSum<T>& all) {
  unrolled<kMostShiftedSides>([&](auto i) {
    constexpr int sides = i + 1;
    if (taps.sides.size() == sides)
      all.channels == 2 ? sum_shifted_of<2, sides>(taps, all) : sum_shifted_of<3, sides>(taps, all);
  });
}

}  // namespace saltus
