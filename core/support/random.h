#pragma once

#include <cmath>
#include <cstdint>
#include <initializer_list>

namespace saltus {

/// Counter-based random numbers: a pure function of the key, so results do not depend on the order of evaluation,
/// the number of threads or the standard library. The mixer is SplitMix64's finaliser (Steele et al. 2014).
inline std::uint64_t random_bits(std::uint64_t seed, std::initializer_list<std::int64_t> key) {
  auto mix = [](std::uint64_t z) {
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    return z ^ (z >> 31);
  };
  std::uint64_t state = mix(seed + 0x9e3779b97f4a7c15ULL);
  for (std::int64_t part : key) state = mix(state + 0x9e3779b97f4a7c15ULL + static_cast<std::uint64_t>(part));
  return state;
}

/// Uniform in [0, 1), 53 bits.
inline double uniform_from(std::uint64_t bits) { return static_cast<double>(bits >> 11) * 0x1.0p-53; }

/// Standard normal (Box-Muller).
inline double normal_random(std::uint64_t seed, std::initializer_list<std::int64_t> key) {
  const std::uint64_t bits = random_bits(seed, key);
  const double radius = std::sqrt(-2.0 * std::log(1.0 - uniform_from(bits)));
  return radius * std::cos(2.0 * 3.14159265358979323846 * uniform_from(random_bits(bits, {1})));
}

/// A sequence of such numbers, for code that draws one after the other.
class RandomSequence {
 public:
  RandomSequence(std::uint64_t seed, std::int64_t stream) : seed_(random_bits(seed, {stream})) {}

  double uniform() { return uniform_from(random_bits(seed_, {count_++})); }
  double uniform(double low, double high) { return low + (high - low) * uniform(); }

 private:
  std::uint64_t seed_;
  std::int64_t count_ = 0;
};

}  // namespace saltus
