#include "core/grid/intensity_range.h"

#include "core/support/ranking.h"

namespace saltus {

template <class T>
IntensityRange intensity_range(std::size_t sites, const T* image, const T* weights) {
  const auto seen = ranking_of_those<T>(sites, [=](std::size_t i, const auto& take) {
    if (!weights || weights[i] > 0) take(image[i]);
  });
  if (seen.count() == 0) return {};
  const std::size_t last = seen.count() - 1;
  const auto percentile = [&](double share) {
    return static_cast<double>(seen.at(static_cast<std::size_t>(share * static_cast<double>(last))));
  };
  const double high = percentile(0.99), low = percentile(0.01);
  if (high > low) return {low, high};
  return {static_cast<double>(seen.at(0)), static_cast<double>(seen.at(last))};
}

template IntensityRange intensity_range(std::size_t, const float*, const float*);
template IntensityRange intensity_range(std::size_t, const double*, const double*);

}  // namespace saltus
