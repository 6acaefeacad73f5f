#pragma once

#include <cmath>
#include <concepts>
#include <limits>
#include <type_traits>

namespace saltus {

// Of numbers, and of registers of them (GNU vector types), where they are one instruction.

template <std::floating_point T>
[[gnu::always_inline]] inline T magnitude(T value) {
  return std::abs(value);
}
/// size * (sign of `sign`)
template <std::floating_point T>
[[gnu::always_inline]] inline T with_sign_flipped(T size, T sign) {
  return std::signbit(sign) ? -size : size;
}
/// The larger of this and 0.
template <std::floating_point T>
[[gnu::always_inline]] inline T positive_part(T value) {
  return value > 0 ? value : T(0);  // std::max gives a reference, which no loop in lanes likes
}

/// The bits of a register of numbers, and of those the signs.
template <class V>
using SignBits = decltype(V{} < V{});
template <class V>
constexpr auto kSignBit = std::numeric_limits<std::remove_cvref_t<decltype(SignBits<V>{}[0])>>::min();

template <class V>
[[gnu::always_inline]] inline V magnitude(V value) {
  return reinterpret_cast<V>(reinterpret_cast<SignBits<V>>(value) & ~kSignBit<V>);
}
template <class V>
[[gnu::always_inline]] inline V with_sign_flipped(V size, V sign) {
  return reinterpret_cast<V>(reinterpret_cast<SignBits<V>>(size) ^ (reinterpret_cast<SignBits<V>>(sign) & kSignBit<V>));
}
/// As whole numbers, of which the larger one is one instruction: those of negative values are negative.
template <class V>
[[gnu::always_inline]] inline V positive_part(V value) {
  const auto bits = reinterpret_cast<SignBits<V>>(value);
  return reinterpret_cast<V>(bits > 0 ? bits : SignBits<V>{});
}

}  // namespace saltus
