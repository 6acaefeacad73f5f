#pragma once

#include "core/grid/lattice.h"

#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

namespace saltus::testing {

/// Small deterministic generator (splitmix64): the same numbers on every machine.
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}
  /// Uniform in [-1, 1).
  double symmetric() {
    state_ += 0x9e3779b97f4a7c15ULL;
    std::uint64_t z = state_;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    z ^= z >> 31;
    return static_cast<double>(z >> 11) * (2.0 / 9007199254740992.0) - 1.0;
  }

 private:
  std::uint64_t state_;
};

inline std::vector<double> random_values(std::size_t count, std::uint64_t seed, double amplitude = 1) {
  Random random(seed);
  std::vector<double> values(count);
  for (double& value : values) value = amplitude * random.symmetric();
  return values;
}

inline Field<double> random_field(std::size_t count, std::uint64_t seed, double amplitude = 1) {
  const std::vector<double> values = random_values(count, seed, amplitude);
  return {values.begin(), values.end()};
}

/// A smooth image: a few plane waves of random direction, phase and wavelength (6 to 20 samples).
template <int Dim>
std::vector<double> random_waves(const Lattice<Dim>& lattice, std::uint64_t seed) {
  Random random(seed);
  std::vector<double> samples(lattice.sites(), 0.0);
  for (int wave = 0; wave < 6; ++wave) {
    double frequency[Dim];
    for (double& f : frequency) f = random.symmetric() * 2 * std::numbers::pi / 6 / std::sqrt(Dim);
    const double phase = random.symmetric() * std::numbers::pi;
    for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab)
      visit_slab<Dim>(lattice, slab, [&](const Index<Dim>& index, std::size_t site) {
        double angle = phase;
        for (int axis = 0; axis < Dim; ++axis) angle += frequency[axis] * index[axis];
        samples[site] += 0.3 * std::sin(angle);
      });
  }
  return samples;
}

}  // namespace saltus::testing
