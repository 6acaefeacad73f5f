#pragma once

namespace saltus {

enum class SimilarityType { Ssd, Lncc };

/// Intensities are in units of the fixed image's range (see core/README.md).
struct SimilarityOptions {
  double weight = 1;              ///< multiplies the similarity
  double lncc_radius_voxels = 2;  ///< half width of the box window, in voxels of the level
  double lncc_floor = 0.01;       ///< standard deviation below which a window is flat
};

}  // namespace saltus
