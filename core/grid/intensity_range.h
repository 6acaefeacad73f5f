#pragma once

#include <cstddef>

namespace saltus {

struct IntensityRange {
  double low = 0, high = 0;
  double width() const { return high - low; }
};

/// The 1st to the 99th percentile of the samples whose weight is above 0 (null weights: all), whatever the others hold;
/// smallest to largest where those coincide. Of width 0 for a constant image, and [0, 0] when nothing is seen.
template <class T>
IntensityRange intensity_range(std::size_t sites, const T* image, const T* weights);

}  // namespace saltus
