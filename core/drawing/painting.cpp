#include "core/drawing/painting.h"

#include "core/evaluation/statistics.h"

namespace saltus::drawing {

template <int Dim>
IntensityWindow window_of(const Volume<Dim>& image) {
  auto values = thinned(image.samples.size(), [&](std::size_t i) { return image.samples[i]; });
  IntensityWindow window{quantile_of(values, 0.002), quantile_of(values, 0.998)};
  if (!(window.high > window.low)) window = {window.low - 0.5, window.low + 0.5};
  return window;
}

template IntensityWindow window_of(const Volume<2>&);
template IntensityWindow window_of(const Volume<3>&);

}  // namespace saltus::drawing
