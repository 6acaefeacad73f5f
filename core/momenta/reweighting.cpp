#include "core/momenta/reweighting.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace saltus {
namespace {

constexpr double kFloor = 0.15;          // of an empty neighbourhood: its weight becomes 1 / 0.15 times its own
constexpr double kShareOfLargest = 0.1;  // neighbourhoods above this share of the largest are shrunk less than before

constexpr double kOfStrongest = 8;  // in 1 / factor, where a velocity changes more than around; as measured

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

bool are_zero(const std::vector<float>& values) {
  return std::all_of(values.begin(), values.end(), [](float value) { return value == 0; });
}

/// Sums over three sites along every axis.
template <int Dim>
void add_neighbours(const Lattice<Dim>& lattice, std::vector<float>& values) {
  std::vector<float> sum(values.size());
  std::size_t stride = 1;
  for (int axis = 0; axis < Dim; ++axis) {
    const std::size_t length = static_cast<std::size_t>(lattice.size[axis]);
    for (std::size_t begin = 0; begin < values.size(); begin += stride * length)
      for (std::size_t i = 0; i < length; ++i)
        for (std::size_t site = begin + stride * i; site < begin + stride * (i + 1); ++site) {
          sum[site] = values[site];
          if (i > 0) sum[site] += values[site - stride];
          if (i + 1 < length) sum[site] += values[site + stride];
        }
    std::swap(sum, values);
    stride *= length;
  }
}

}  // namespace

template <int Dim>
std::vector<std::vector<float>> reweighted_factors(const Lattice<Dim>& lattice, std::vector<std::vector<float>> sizes) {
  float largest = 0;
  for (std::vector<float>& size : sizes) {
    if (are_zero(size)) continue;  // most normals have no element
    add_neighbours(lattice, size);
    largest = std::max(largest, *std::max_element(size.begin(), size.end()));
  }
  for (std::vector<float>& size : sizes) {
    if (are_zero(size)) {
      std::fill(size.begin(), size.end(), static_cast<float>(1 / kFloor));
      continue;
    }
    for (float& factor : size)
      factor = static_cast<float>(1 / (kFloor + (largest > 0 ? factor / (kShareOfLargest * largest) : 0.0)));
  }
  return sizes;
}

template <class T>
std::vector<float> shear_factors(const std::vector<T>& shares) {
  std::vector<float> factors(shares.size());
  std::transform(shares.begin(), shares.end(), factors.begin(), [](T share) {
    const double square = static_cast<double>(share) * share;
    return static_cast<float>(1 / (kFloor + kOfStrongest * square * square));
  });
  return factors;
}

std::vector<std::vector<float>> support_factors(std::vector<std::vector<float>> sizes) {
  for (std::vector<float>& size : sizes)
    for (float& factor : size) factor = factor > 0 ? 0 : std::numeric_limits<float>::infinity();
  return sizes;
}

template <int Dim, class T>
std::vector<std::vector<float>> momentum_sizes(const Lattice<Dim>& lattice, const T* first, int fields) {
  std::vector<std::vector<float>> all;
  for (int field = 0; field < fields; ++field) all.push_back(sizes(lattice, first + field * Dim * lattice.sites()));
  return all;
}

template std::vector<std::vector<float>> reweighted_factors(const Lattice<2>&, std::vector<std::vector<float>>);
template std::vector<std::vector<float>> reweighted_factors(const Lattice<3>&, std::vector<std::vector<float>>);
template std::vector<float> shear_factors(const std::vector<float>&);
template std::vector<float> shear_factors(const std::vector<double>&);
#define SALTUS_INSTANTIATE(DIM, T) \
  template std::vector<std::vector<float>> momentum_sizes(const Lattice<DIM>&, const T*, int)
SALTUS_INSTANTIATE(2, float);
SALTUS_INSTANTIATE(3, float);
SALTUS_INSTANTIATE(2, double);
SALTUS_INSTANTIATE(3, double);
#undef SALTUS_INSTANTIATE

}  // namespace saltus
