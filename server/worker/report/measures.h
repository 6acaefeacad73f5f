#pragma once

#include "server/worker/report/interface.h"
#include "server/worker/report/report.h"

#include <optional>
#include <vector>

namespace saltus::report {

struct DisplacementMeasures {
  double mean_mm = 0;
  double max_mm = 0;
};

/// Distances of landmarks from where they should be, mm.
struct LandmarkMeasures {
  std::vector<double> before;                ///< landmark_distances
  std::optional<std::vector<double>> start;  ///< after the affine start alone, when there is one
  std::vector<double> after;                 ///< landmark_errors of the displacement
  std::vector<double> particles;             ///< the same of the points that the flow itself carried to its end
  int particles_stopped = 0;                 ///< points that ended elsewhere, see TrajectoryEnd
};

template <int Dim>
DisplacementMeasures measure_displacement(const VectorVolume<Dim>& displacement);

/// Empty when there are no landmarks. Throws InvalidInput when the numbers of landmarks differ.
template <int Dim>
std::optional<LandmarkMeasures> measure_landmarks(const ReportInput<Dim>& input);

/// Voxels with J <= 0 inside the image (without its outermost voxels).
struct FoldedVoxels {
  std::size_t n = 0;
  std::size_t off_interface = 0;  ///< of these, more than two voxels from every face, where no jump explains them
};

template <int Dim>
FoldedVoxels count_folded(const Volume<Dim>& jacobian, const DetectedInterface<Dim>& interface);

/// Share of the voxels that u carries out of the voxels of `other`, in [0,1].
template <int Dim>
double share_carried_beyond(const VectorVolume<Dim>& displacement, const ImageGrid<Dim>& other);

/// Share of the sites where the momentum is not zero, in [0,1].
template <int Dim>
double active_share(const VectorVolume<Dim>& momentum);

}  // namespace saltus::report
