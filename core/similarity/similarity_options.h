#pragma once

namespace saltus {

enum class SimilarityType { Ssd, Ncc, Lncc, Mi, Ngf, Mind };

/// Intensities are in units of the fixed image's range (see core/README.md).
struct SimilarityOptions {
  double noise = -1;              ///< sd of the white noise in both images; -1: estimated, see grid/noise.h
  double smoothing_voxels = -1;   ///< Gaussian that both images are smoothed with, sd in voxels of the level; -1: as
                                  ///< little as keeps the noise from favouring displacements by half a voxel
  double lost_noise = 0.0075;     ///< sd of what linear interpolation may take from the noise, which smoothing follows;
                                  ///< 0: what was measured (core/measurements.md, "Finer images")
  double ssd_residual = 0.014;    ///< sd of what ssd leaves beside noise: its weight is 1 / (1 + (noise / this)^2)
  double weight = 1;              ///< multiplies the similarity
  double ncc_floor = 0.001;       ///< standard deviation below which an image is flat
  double lncc_radius_voxels = 0;  ///< half width of the windows, in voxels of the level; 0: by dimension
  int lncc_cell = 0;              ///< samples along an axis that windows are made of and move by; 0: by dimension
  double lncc_floor = 0.01;       ///< standard deviation below which a window is flat
  int mi_bins = 32;               ///< for each image, in the joint histogram
  double ngf_edge = 0;            ///< intensity per mm below which a gradient counts little; 0: from the images
  double mind_radius_voxels = 1;  ///< half width of the patches, in voxels of the level
  double mind_step_voxels = 1;  ///< from a sample to the neighbours whose patches are compared, in voxels of the level
};

}  // namespace saltus
