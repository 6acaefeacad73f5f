#pragma once

#include "core/grid/volume.h"

namespace saltus {

/// A copy of `image` in which values below `low` are `low` and values above `high` are `high`.
/// Throws InvalidInput unless both are finite and low < high.
template <int Dim>
Volume<Dim> clip_intensities(const Volume<Dim>& image, float low, float high);

}  // namespace saltus
