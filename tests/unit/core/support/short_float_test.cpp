#include "core/support/short_float.h"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

namespace saltus {
namespace {

float stored(float value) { return ShortFloat(value); }
float of_bits(std::uint32_t bits) { return std::bit_cast<float>(bits); }

TEST(ShortFloat, BeginsAsZero) { EXPECT_EQ(static_cast<float>(ShortFloat()), 0.0f); }

// All there are.
TEST(ShortFloat, GivesBackWhatItHolds) {
  for (std::uint32_t half = 0; half < 1u << 16; ++half) {
    const float value = of_bits(half << 16);
    if (std::isnan(value))
      EXPECT_TRUE(std::isnan(stored(value))) << half;
    else
      EXPECT_EQ(std::bit_cast<std::uint32_t>(stored(value)), half << 16);
  }
}

// Oracle: no neighbour is nearer, and of two that are as near the one with an even last bit.
TEST(ShortFloat, IsTheNearest) {
  std::uint32_t bits = 0;
  for (int i = 0; i < 200000; ++i) {
    bits = bits * 1664525u + 1013904223u;  // all of them are numbers now and then
    for (std::uint32_t low : {bits & 0xffff, 0x7fffu, 0x8000u, 0x8001u}) {
      const std::uint32_t at = (bits & 0xffff0000) | low;
      const float value = of_bits(at);
      if (!std::isfinite(value) || std::abs(value) > 3.38e38f) continue;
      const double below = of_bits(at & 0xffff0000), above = of_bits((at & 0xffff0000) + 0x10000);
      const double to_below = std::abs(value - below), to_above = std::abs(value - above);
      const bool is_even = (at >> 16 & 1) == 0;
      EXPECT_EQ(stored(value), to_below < to_above || (to_below == to_above && is_even) ? below : above) << value;
      if (std::abs(value) >= std::ldexp(1.0f, -126)) {
        EXPECT_LE(std::abs(stored(value) - static_cast<double>(value)), std::ldexp(std::abs(value), -8));
      }
    }
  }
}

TEST(ShortFloat, KeepsWhatIsNoNumber) {
  constexpr float inf = std::numeric_limits<float>::infinity();
  EXPECT_EQ(stored(inf), inf);
  EXPECT_EQ(stored(-inf), -inf);
  EXPECT_EQ(stored(std::numeric_limits<float>::max()), inf);
  for (std::uint32_t bits : {0x7fc00000u, 0x7f800001u, 0x7fffffffu, 0xff800001u, 0xffffffffu})
    EXPECT_TRUE(std::isnan(stored(of_bits(bits)))) << bits;
}

TEST(ShortFloat, IsZeroOnlyWhereNothingIsLeft) {
  EXPECT_EQ(stored(std::ldexp(1.0f, -134)), 0.0f);
  EXPECT_GT(stored(std::ldexp(1.01f, -134)), 0.0f);
  EXPECT_TRUE(std::signbit(stored(-0.0f)));
  EXPECT_TRUE(std::signbit(stored(-std::ldexp(1.0f, -140))));
}

}  // namespace
}  // namespace saltus
