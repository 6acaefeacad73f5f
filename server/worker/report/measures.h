#pragma once

#include "server/worker/report/report.h"

#include <optional>
#include <vector>

namespace saltus::report {

struct JacobianMeasures {
  double min = 0;
  double max = 0;
  double share_not_positive = 0;  ///< of all voxels, in [0,1]
  double sd_log = 0;              ///< of log J over the voxels where J > 0
};

struct DisplacementMeasures {
  double mean_mm = 0;
  double max_mm = 0;
};

/// Distances of landmarks from where they should be, mm.
struct LandmarkMeasures {
  std::vector<double> before;                ///< |moving point - fixed point|
  std::optional<std::vector<double>> start;  ///< after the affine start alone, when there is one
  std::vector<double> after;                 ///< |moving point - (fixed point + u)|, u interpolated linearly
};

struct Statistics {
  std::size_t count = 0;
  double mean = 0;
  double sd = 0;  ///< of the sample (n - 1); 0 for one value
  double median = 0;
  double p90 = 0;  ///< linear between ranks
  double max = 0;
};

/// Precondition: at least one value.
Statistics statistics(std::vector<double> values);

/// The value below which `share` in [0,1] of the values lie, linear between ranks. Precondition: at least one value.
double quantile(std::vector<float> values, double share);

template <int Dim>
JacobianMeasures measure_jacobian(const Volume<Dim>& jacobian);

template <int Dim>
DisplacementMeasures measure_displacement(const VectorVolume<Dim>& displacement);

/// Empty when there are no landmarks. Throws InvalidInput when the numbers of landmarks differ.
template <int Dim>
std::optional<LandmarkMeasures> measure_landmarks(const ReportInput<Dim>& input);

/// Share of the sites where the momentum is not zero, in [0,1].
template <int Dim>
double active_share(const VectorVolume<Dim>& momentum);

}  // namespace saltus::report
