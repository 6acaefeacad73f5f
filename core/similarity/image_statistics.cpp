#include "core/similarity/image_statistics.h"

#include <algorithm>
#include <cmath>

namespace saltus {

template <class T>
IntensityRange intensity_range(std::size_t sites, const T* image, const T* weights) {
  std::vector<T> seen;
  seen.reserve(sites);
  for (std::size_t i = 0; i < sites; ++i)
    if (!weights || weights[i] > 0) seen.push_back(image[i]);
  if (seen.empty()) return {};
  const auto percentile = [&](double share) {
    const auto at = seen.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(seen.size() - 1));
    std::nth_element(seen.begin(), at, seen.end());
    return static_cast<double>(*at);
  };
  const double high = percentile(0.99), low = percentile(0.01);
  if (high > low) return {low, high};
  const auto [smallest, largest] = std::minmax_element(seen.begin(), seen.end());
  return {static_cast<double>(*smallest), static_cast<double>(*largest)};
}

template <int Dim, class T>
double noise_deviation(const Lattice<Dim>& lattice, const T* image, const T* weights) {
  // The stencil is the product of (1, -2, 1) over the axes that have room for it; its squares sum to 6 an axis.
  std::vector<std::pair<std::ptrdiff_t, double>> stencil = {{0, 1.0}};
  double squares = 1;
  std::ptrdiff_t stride = 1;
  for (int extent : lattice.size) {
    if (extent >= 3) {
      std::vector<std::pair<std::ptrdiff_t, double>> wider;
      for (const auto& [offset, tap] : stencil)
        for (int step : {-1, 0, 1}) wider.emplace_back(offset + step * stride, step == 0 ? -2 * tap : tap);
      stencil = std::move(wider);
      squares *= 6;
    }
    stride *= extent;
  }
  if (stencil.size() == 1) return 0;
  std::vector<double> differences;
  for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab)
    visit_slab<Dim>(lattice, slab, [&](const Index<Dim>& index, std::size_t site) {
      for (int axis = 0; axis < Dim; ++axis)
        if (lattice.size[axis] >= 3 && (index[axis] == 0 || index[axis] == lattice.size[axis] - 1)) return;
      double sum = 0;
      for (const auto& [offset, tap] : stencil) {
        const std::size_t at = site + static_cast<std::size_t>(offset);
        if (weights && !(weights[at] > 0)) return;
        sum += tap * image[at];
      }
      differences.push_back(std::abs(sum));
    });
  if (differences.empty()) return 0;
  const auto middle = differences.begin() + static_cast<std::ptrdiff_t>(differences.size() / 2);
  std::nth_element(differences.begin(), middle, differences.end());
  return 1.4826 * *middle / std::sqrt(squares);  // 1.4826: standard deviation over median magnitude of a normal value
}

template IntensityRange intensity_range(std::size_t, const float*, const float*);
template IntensityRange intensity_range(std::size_t, const double*, const double*);
template double noise_deviation(const Lattice<2>&, const float*, const float*);
template double noise_deviation(const Lattice<3>&, const float*, const float*);
template double noise_deviation(const Lattice<2>&, const double*, const double*);
template double noise_deviation(const Lattice<3>&, const double*, const double*);

}  // namespace saltus
