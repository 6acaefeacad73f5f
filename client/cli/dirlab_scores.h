#pragma once

#include "core/evaluation/statistics.h"
#include "core/grid/volume.h"

#include <map>
#include <string>
#include <vector>

namespace saltus::cli {

/// |p + u(p) - q|, as it is, and with p + u(p) moved to the nearest voxel first, as DIR-Lab's own table has it: the
/// landmarks are voxels. mm, in the landmarks' order.
struct LandmarkScores {
  std::vector<double> raw, snapped;
};
LandmarkScores score_landmarks(const VectorVolume<3>& displacement, const std::vector<Vector<3>>& fixed,
                               const std::vector<Vector<3>>& moving);

/// Two-sided Wilcoxon signed-rank test of paired values: pairs that are equal are left out, ties share their rank, p by
/// the normal approximation with the correction for ties. Oracle of the formulas: Hollander and Wolfe, "Nonparametric
/// Statistical Methods", 3.1. p is 1 when all pairs are equal. Throws InvalidInput when the numbers differ.
struct SignedRank {
  double z = 0;
  double p = 1;
};
SignedRank signed_rank_test(const std::vector<double>& a, const std::vector<double>& b);

/// Mean errors after registration that the paper's table gives for a case, by model: gaussian, wendland, wendland1 (its
/// proposed one). Empty for a model that it does not have.
std::map<std::string, double> paper_errors(int case_number);

}  // namespace saltus::cli
