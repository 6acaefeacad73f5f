#include "core/slip/slip_surface.h"

#include <algorithm>
#include <utility>

namespace saltus {
namespace {

/// The least value that 95 % of the weight lie at or below.
double upper_end(std::vector<std::pair<double, double>> weighted) {
  std::sort(weighted.begin(), weighted.end());
  double all = 0, below = 0;
  for (const auto& [value, weight] : weighted) all += weight;
  for (const auto& [value, weight] : weighted)
    if ((below += weight) >= 0.95 * all) return value;
  return weighted.empty() ? 0 : weighted.back().first;
}

}  // namespace

template <int Dim>
SlipSummary summarise(const SlipSurface<Dim>& surface) {
  SlipSummary found;
  std::vector<std::pair<double, double>> jumps, gaps, overlaps;
  for (const SlipPoint<Dim>& point : surface.points) {
    const double jump = point.jump.norm();
    found.area += point.area;
    found.parts = std::max(found.parts, point.part + 1);
    found.jump_mean_mm += point.area * jump;
    found.jump_max_mm = std::max(found.jump_max_mm, jump);
    jumps.emplace_back(jump, point.area);
    gaps.emplace_back(std::max(0.0, point.gap_mm), point.area);
    overlaps.emplace_back(std::max(0.0, -point.gap_mm), point.area);
  }
  if (found.area > 0) found.jump_mean_mm /= found.area;
  found.jump_p95_mm = upper_end(std::move(jumps));
  found.gap_p95_mm = upper_end(std::move(gaps));
  found.overlap_p95_mm = upper_end(std::move(overlaps));
  return found;
}

template SlipSummary summarise(const SlipSurface<2>&);
template SlipSummary summarise(const SlipSurface<3>&);

}  // namespace saltus
