#include "core/momenta/reweighting.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace saltus {
namespace {

constexpr double kFloor = 0.15;          // of an empty neighbourhood: its weight becomes 1 / 0.15 times its own
constexpr double kShareOfLargest = 0.1;  // neighbourhoods above this share of the largest are shrunk less than before

template <int Dim, class T>
std::vector<float> sizes(const Lattice<Dim>& lattice, const T* field) {
  std::vector<float> size(lattice.sites());
  for (std::size_t site = 0; site < size.size(); ++site) {
    double square = 0;
    for (int k = 0; k < Dim; ++k) square += static_cast<double>(field[Dim * site + k]) * field[Dim * site + k];
    size[site] = static_cast<float>(std::sqrt(square));
  }
  return size;
}

/// Sums over three sites along every axis.
template <int Dim>
void add_neighbours(const Lattice<Dim>& lattice, std::vector<float>& values) {
  std::vector<float> sum(values.size());
  std::size_t stride = 1;
  for (int axis = 0; axis < Dim; ++axis) {
    const std::size_t length = static_cast<std::size_t>(lattice.size[axis]);
    for (std::size_t site = 0; site < values.size(); ++site) {
      const std::size_t i = site / stride % length;
      sum[site] = values[site];
      if (i > 0) sum[site] += values[site - stride];
      if (i + 1 < length) sum[site] += values[site + stride];
    }
    std::swap(sum, values);
    stride *= length;
  }
}

}  // namespace

template <int Dim, class T>
std::vector<std::vector<float>> reweighted_factors(const Lattice<Dim>& lattice, const T* first, int fields) {
  std::vector<std::vector<float>> factors;
  float largest = 0;
  for (int axis = 0; axis < fields; ++axis) {
    factors.push_back(sizes(lattice, first + axis * Dim * lattice.sites()));
    add_neighbours(lattice, factors.back());
    largest = std::max(largest, *std::max_element(factors.back().begin(), factors.back().end()));
  }
  for (std::vector<float>& axis : factors)
    for (float& factor : axis)
      factor = static_cast<float>(1 / (kFloor + (largest > 0 ? factor / (kShareOfLargest * largest) : 0.0)));
  return factors;
}

template <int Dim, class T>
std::vector<std::vector<float>> support_factors(const Lattice<Dim>& lattice, const T* first, int fields) {
  std::vector<std::vector<float>> factors;
  for (int axis = 0; axis < fields; ++axis) {
    factors.push_back(sizes(lattice, first + axis * Dim * lattice.sites()));
    for (float& factor : factors.back()) factor = factor > 0 ? 0 : std::numeric_limits<float>::infinity();
  }
  return factors;
}

#define SALTUS_INSTANTIATE(DIM, T)                                                                 \
  template std::vector<std::vector<float>> reweighted_factors(const Lattice<DIM>&, const T*, int); \
  template std::vector<std::vector<float>> support_factors(const Lattice<DIM>&, const T*, int)
SALTUS_INSTANTIATE(2, float);
SALTUS_INSTANTIATE(3, float);
SALTUS_INSTANTIATE(2, double);
SALTUS_INSTANTIATE(3, double);
#undef SALTUS_INSTANTIATE

}  // namespace saltus
