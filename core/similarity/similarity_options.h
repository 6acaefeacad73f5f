#pragma once

namespace saltus {

enum class SimilarityType { Ssd, Lncc };

/// Intensities are in units of the fixed image's range (see core/README.md).
struct SimilarityOptions {
  double noise = -1;             ///< sd of the white noise in both images; -1: estimated, see grid/noise.h
  double smoothing_voxels = -1;  ///< Gaussian that both images are smoothed with, sd in voxels of the level; -1: as
                                 ///< little as keeps the noise from favouring displacements by half a voxel
  double ssd_residual = 0.014;   ///< sd of what ssd leaves beside noise: its weight is 1 / (1 + (noise / this)^2)
  double weight = 1;              ///< multiplies the similarity
  double lncc_radius_voxels = 2;  ///< half width of the box window, in voxels of the level
  double lncc_floor = 0.01;       ///< standard deviation below which a window is flat
};

}  // namespace saltus
