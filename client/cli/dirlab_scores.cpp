#include "client/cli/dirlab_scores.h"

#include "core/evaluation/field_error.h"
#include "core/evaluation/field_sampling.h"
#include "core/support/errors.h"

#include <algorithm>
#include <cmath>

namespace saltus::cli {

LandmarkScores score_landmarks(const VectorVolume<3>& displacement, const std::vector<Vector<3>>& fixed,
                               const std::vector<Vector<3>>& moving) {
  LandmarkScores scores{landmark_errors(displacement, fixed, moving), {}};
  const std::vector<Vector<3>> carried = transform_points(displacement, fixed);
  const ImageGrid<3>& grid = displacement.grid;
  for (std::size_t i = 0; i < carried.size(); ++i) {
    const Vector<3> nearest = grid.to_index(carried[i]).array().round().matrix();
    scores.snapped.push_back((grid.to_world(nearest) - moving[i]).norm());
  }
  return scores;
}

SignedRank signed_rank_test(const std::vector<double>& a, const std::vector<double>& b) {
  if (a.size() != b.size()) throw InvalidInput("a signed-rank test needs as many values on both sides");
  std::vector<double> differences;
  for (std::size_t i = 0; i < a.size(); ++i)
    if (a[i] != b[i]) differences.push_back(a[i] - b[i]);
  if (differences.empty()) return {};
  std::sort(differences.begin(), differences.end(), [](double x, double y) { return std::abs(x) < std::abs(y); });
  const auto n = static_cast<double>(differences.size());
  double positive = 0, ties = 0;
  for (std::size_t begin = 0; begin < differences.size();) {
    std::size_t end = begin;
    while (end < differences.size() && std::abs(differences[end]) == std::abs(differences[begin])) ++end;
    const double rank = (static_cast<double>(begin + end) + 1) / 2, many = static_cast<double>(end - begin);
    for (std::size_t i = begin; i < end; ++i) positive += differences[i] > 0 ? rank : 0;
    ties += many * many * many - many;
    begin = end;
  }
  const double variance = n * (n + 1) * (2 * n + 1) / 24 - ties / 48;
  SignedRank found;
  found.z = (positive - n * (n + 1) / 4) / std::sqrt(variance);
  found.p = std::erfc(std::abs(found.z) / std::sqrt(2.0));
  return found;
}

std::map<std::string, double> paper_errors(int case_number) {
  // Bao, Lu, Ying, Sommer, "Sliding at first order", table of target registration errors.
  constexpr double table[10][3] = {{0.84, 0.83, 0.77}, {0.81, 0.78, 0.79}, {1.32, 1.35, 1.32}, {1.64, 1.64, 1.77},
                                   {2.17, 2.20, 2.15}, {2.39, 2.36, 2.66}, {3.43, 3.40, 3.42}, {8.54, 8.55, 8.86},
                                   {2.10, 2.09, 1.47}, {2.14, 2.15, 1.71}};
  if (case_number < 1 || case_number > 10) return {};
  const double* const row = table[case_number - 1];
  return {{"gaussian", row[0]}, {"wendland", row[1]}, {"wendland1", row[2]}};
}

}  // namespace saltus::cli
