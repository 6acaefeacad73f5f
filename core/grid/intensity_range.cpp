#include "core/grid/intensity_range.h"

#include <algorithm>
#include <vector>

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

template IntensityRange intensity_range(std::size_t, const float*, const float*);
template IntensityRange intensity_range(std::size_t, const double*, const double*);

}  // namespace saltus
