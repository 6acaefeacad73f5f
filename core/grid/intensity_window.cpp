#include "core/grid/intensity_window.h"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "core/support/errors.h"

namespace saltus {

template <int Dim>
Volume<Dim> clip_intensities(const Volume<Dim>& image, float low, float high) {
  if (!std::isfinite(low) || !std::isfinite(high) || !(low < high)) {
    std::ostringstream text;
    text << "intensity window is " << low << " to " << high << "; both must be finite and the first the smaller";
    throw InvalidInput(text.str());
  }
  Volume<Dim> clipped = image;
  for (float& sample : clipped.samples) sample = std::clamp(sample, low, high);
  return clipped;
}

template Volume<2> clip_intensities(const Volume<2>&, float, float);
template Volume<3> clip_intensities(const Volume<3>&, float, float);

}  // namespace saltus
