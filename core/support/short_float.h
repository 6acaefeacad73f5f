#pragma once

#include <bit>
#include <cstdint>

namespace saltus {

/// A float in 16 bits ("bfloat16"): its upper half, rounded to the nearest, halves to even. The range of a float, and a
/// relative error of at most 2^-8 above 2^-126; below, where they are 2^-133 apart, one of at most 2^-134, so that what
/// is at most that becomes 0 with its sign. Infinity stays, as NaN does; 2^128 (1 - 2^-9) and more becomes infinity.
/// What is stored comes back as the float that it is, exactly.
class ShortFloat {
 public:
  ShortFloat() = default;  ///< 0
  explicit ShortFloat(float value) : bits_(rounded(value)) {}
  ShortFloat& operator=(float value) {  // of its own: loops that copy an object are not put into lanes
    bits_ = rounded(value);
    return *this;
  }
  operator float() const { return std::bit_cast<float>(static_cast<std::uint32_t>(bits_) << 16); }

 private:
  static std::uint16_t rounded(float value) {
    const auto bits = std::bit_cast<std::uint32_t>(value);
    const std::uint32_t nearest = bits + 0x7fff + (bits >> 16 & 1);
    const bool is_nan = (bits & 0x7fffffff) > 0x7f800000;
    // A NaN whose upper half is that of infinity has to stay one.
    return static_cast<std::uint16_t>((is_nan ? bits | 0x400000 : nearest) >> 16);
  }

  std::uint16_t bits_ = 0;
};
static_assert(sizeof(ShortFloat) == 2);

}  // namespace saltus
