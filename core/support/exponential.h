#pragma once

#include <bit>
#include <cmath>
#include <cstdint>

namespace saltus {

/// e^x, for loops in lanes. In single precision within 2e-7 of it, as a share, for x from -87 to 88.5, and what it is
/// at these beyond them; what is no number stays that.
[[gnu::always_inline]] inline float exponential(float x) {
  // x = n log 2 + r, |r| <= log(2) / 2, and e^r as a power series, whose rest is below 6e-9.
  constexpr float per_log2 = 1.44269504f, round = 12582912;  // 1.5 * 2^23: the last digits of a sum with it are whole
  constexpr float log2_high = 0.693359375f, log2_low = -2.12194440e-4f;  // high: times n exact
  const float low = x < -87.0f ? -87.0f : x, bounded = low > 88.5f ? 88.5f : low;
  const float shifted = bounded * per_log2 + round, n = shifted - round;
  const float r = (bounded - n * log2_high) - n * log2_low;
  const float tail = ((r * (1.0f / 5040) + 1.0f / 720) * r + 1.0f / 120) * r + 1.0f / 24;
  const float power = (((tail * r + 1.0f / 6) * r + 0.5f) * r + 1) * r + 1;
  // n goes into the exponent. What is no number would lose that with it.
  const float found =
      std::bit_cast<float>(std::bit_cast<std::uint32_t>(power) + (std::bit_cast<std::uint32_t>(shifted) << 23));
  return x == x ? found : x;
}
inline double exponential(double x) { return std::exp(x); }

}  // namespace saltus
