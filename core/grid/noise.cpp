#include "core/grid/noise.h"

#include "core/support/ranking.h"

#include <algorithm>
#include <cmath>

namespace saltus {
namespace {

/// Variances of unit white noise after smoothing along one axis with a Gaussian: of a sample, and of the mean of two
/// neighbours.
struct SmoothedNoise {
  double at_sample = 1, half_way = 0.5;

  explicit SmoothedNoise(double sigma) {
    if (!(sigma > 0)) return;
    const int radius = static_cast<int>(std::ceil(4 * sigma));
    std::vector<double> taps;
    double total = 0;
    for (int j = -radius; j <= radius; ++j) total += taps.emplace_back(std::exp(-0.5 * j * j / (sigma * sigma)));
    double square = 0, neighbours = 0;
    for (std::size_t j = 0; j < taps.size(); ++j) {
      square += taps[j] * taps[j];
      if (j > 0) neighbours += taps[j] * taps[j - 1];
    }
    at_sample = square / (total * total);
    half_way = (square + neighbours) / (2 * total * total);
  }
};

}  // namespace

template <int Dim, class T>
double noise_sd(const Lattice<Dim>& lattice, const T* samples, const T* weights) {
  struct Tap {
    std::ptrdiff_t at;
    double value;
  };
  std::vector<Tap> taps = {{0, 1.0}};
  std::array<bool, Dim> used{};
  std::ptrdiff_t stride = 1;
  for (int axis = 0; axis < Dim; ++axis) {
    used[axis] = lattice.size[axis] >= 3;
    if (used[axis]) {
      std::vector<Tap> product;
      for (const Tap& tap : taps)
        for (int j = -1; j <= 1; ++j)
          product.push_back({tap.at + j * stride, tap.value * (j == 0 ? -2 : 1) / std::sqrt(6.0)});
      taps = product;
    }
    stride *= lattice.size[axis];
  }
  // Row by row, each tap along the whole of it.
  const int nx = lattice.size[0], rows = Dim == 3 ? lattice.size[1] : 1;
  const int begin = used[0] ? 1 : 0, end = used[0] ? nx - 1 : nx;
  const auto is_border = [&](int axis, int i) { return used[axis] && (i == 0 || i == lattice.size[axis] - 1); };
  const auto slabs = static_cast<std::size_t>(lattice.size[Dim - 1]);
  const std::size_t sites_of_slab = lattice.sites() / slabs;
  constexpr T none = -1;
  std::vector<T> sizes(lattice.sites(), none);  // of the responses
#pragma omp parallel
  {
    std::vector<double> responses(static_cast<std::size_t>(nx));
    std::vector<int> varies(responses.size()), counts(responses.size());
#pragma omp for schedule(static)
    for (std::size_t slab = 0; slab < slabs; ++slab)
      for (int row = 0; row < rows; ++row) {
        if (is_border(Dim - 1, static_cast<int>(slab)) || (Dim == 3 && is_border(1, row))) continue;
        const std::size_t first = slab * sites_of_slab + static_cast<std::size_t>(row) * static_cast<std::size_t>(nx);
        const T* const here = samples + first;
        std::fill(responses.begin(), responses.end(), 0.0);
        std::fill(varies.begin(), varies.end(), 0);
        std::fill(counts.begin(), counts.end(), 1);
        for (const Tap& tap : taps) {
          const T* const there = here + tap.at;
#pragma omp simd
          for (int x = begin; x < end; ++x) {
            responses[x] += tap.value * there[x];
            varies[x] |= there[x] != here[x];
          }
          if (!weights) continue;
          const T* const weight = weights + first + tap.at;
          for (int x = begin; x < end; ++x) counts[x] &= weight[x] > 0;
        }
        for (int x = begin; x < end; ++x)
          if (varies[x] && counts[x])
            sizes[first + static_cast<std::size_t>(x)] = static_cast<T>(std::abs(responses[x]));
      }
  }
  const auto ranking = ranking_of_those<T>(sizes.size(), [&](std::size_t i, const auto& take) {
    if (sizes[i] != none) take(sizes[i]);
  });
  if (ranking.count() == 0) return 0;
  return ranking.at(ranking.count() / 2) / 0.6745;  // the median of |x| for a normal x of standard deviation 1
}

double smoothing_against_noise(double noise, int dimension, double tolerance) {
  const auto lost = [&](double sigma) {
    const SmoothedNoise axis(sigma);
    return noise * noise * std::pow(axis.at_sample, dimension - 1) * (axis.at_sample - axis.half_way);
  };
  const double allowed = tolerance * tolerance;
  double low = 0, high = 2;
  if (lost(low) <= allowed) return low;
  for (int step = 0; step < 30; ++step) {
    const double middle = (low + high) / 2;
    (lost(middle) > allowed ? low : high) = middle;
  }
  return high;
}

template double noise_sd(const Lattice<2>&, const float*, const float*);
template double noise_sd(const Lattice<3>&, const float*, const float*);
template double noise_sd(const Lattice<2>&, const double*, const double*);
template double noise_sd(const Lattice<3>&, const double*, const double*);

}  // namespace saltus
