#include "core/grid/noise.h"

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
  std::vector<double> sizes;
  for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab)
    visit_slab<Dim>(lattice, slab, [&](const Index<Dim>& index, std::size_t site) {
      for (int axis = 0; axis < Dim; ++axis)
        if (used[axis] && (index[axis] == 0 || index[axis] == lattice.size[axis] - 1)) return;
      double response = 0;
      bool varies = false;
      for (const Tap& tap : taps) {
        const std::size_t at = site + tap.at;
        if (weights && !(weights[at] > 0)) return;
        varies = varies || samples[at] != samples[site];
        response += tap.value * samples[at];
      }
      if (varies) sizes.push_back(std::abs(response));
    });
  if (sizes.empty()) return 0;
  const auto median = sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() / 2);
  std::nth_element(sizes.begin(), median, sizes.end());
  return *median / 0.6745;  // the median of |x| for a normal x of standard deviation 1
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
