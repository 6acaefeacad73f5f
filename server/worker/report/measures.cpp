#include "server/worker/report/measures.h"

#include "core/support/errors.h"
#include "server/worker/report/field_sampling.h"

#include <algorithm>
#include <cmath>

namespace saltus::report {
namespace {

template <class Number>
double ranked(const std::vector<Number>& sorted, double share) {
  const double at = share * static_cast<double>(sorted.size() - 1);
  const auto low = static_cast<std::size_t>(at);
  const std::size_t high = std::min(low + 1, sorted.size() - 1);
  return sorted[low] + (at - static_cast<double>(low)) * (sorted[high] - sorted[low]);
}

template <int Dim>
double length(const VectorVolume<Dim>& field, std::size_t voxel) {
  double sum = 0;
  for (int c = 0; c < Dim; ++c) sum += std::pow(static_cast<double>(field.component(c)[voxel]), 2);
  return std::sqrt(sum);
}

}  // namespace

Statistics statistics(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  Statistics found;
  found.count = values.size();
  for (double value : values) found.mean += value / static_cast<double>(values.size());
  for (double value : values) found.sd += (value - found.mean) * (value - found.mean);
  found.sd = values.size() > 1 ? std::sqrt(found.sd / static_cast<double>(values.size() - 1)) : 0;
  found.median = ranked(values, 0.5);
  found.p90 = ranked(values, 0.9);
  found.max = values.back();
  return found;
}

double quantile(std::vector<float> values, double share) {
  std::sort(values.begin(), values.end());
  return ranked(values, share);
}

template <int Dim>
JacobianMeasures measure_jacobian(const Volume<Dim>& jacobian) {
  JacobianMeasures found;
  const auto [least, most] = std::minmax_element(jacobian.samples.begin(), jacobian.samples.end());
  found.min = *least;
  found.max = *most;
  std::size_t positive = 0;
  double sum = 0, sum_of_squares = 0;
  for (float value : jacobian.samples) {
    if (!(value > 0)) continue;
    const double logarithm = std::log(static_cast<double>(value));
    ++positive;
    sum += logarithm;
    sum_of_squares += logarithm * logarithm;
  }
  found.share_not_positive = 1 - static_cast<double>(positive) / static_cast<double>(jacobian.samples.size());
  if (positive > 0) {
    const double mean = sum / static_cast<double>(positive);
    found.sd_log = std::sqrt(std::max(0.0, sum_of_squares / static_cast<double>(positive) - mean * mean));
  }
  return found;
}

template <int Dim>
DisplacementMeasures measure_displacement(const VectorVolume<Dim>& displacement) {
  DisplacementMeasures found;
  const std::size_t voxels = displacement.grid.voxels();
  for (std::size_t voxel = 0; voxel < voxels; ++voxel) {
    const double distance = length(displacement, voxel);
    found.mean_mm += distance / static_cast<double>(voxels);
    found.max_mm = std::max(found.max_mm, distance);
  }
  return found;
}

template <int Dim>
std::optional<LandmarkMeasures> measure_landmarks(const ReportInput<Dim>& input) {
  const auto &fixed = input.fixed_points, &moving = input.moving_points;
  if (fixed.size() != moving.size())
    throw InvalidInput("there are " + std::to_string(fixed.size()) + " fixed and " + std::to_string(moving.size()) +
                       " moving landmarks; give as many of the one as of the other");
  if (fixed.empty()) return std::nullopt;
  const AffineMap<Dim>& start = input.input->start;
  const VectorVolume<Dim>& displacement = input.result->displacement;
  LandmarkMeasures found;
  if (!(start == AffineMap<Dim>{})) found.start.emplace();
  for (std::size_t i = 0; i < fixed.size(); ++i) {
    const Vector<Dim> u = sample(displacement, displacement.grid.to_index(fixed[i]));
    found.before.push_back((moving[i] - fixed[i]).norm());
    if (found.start) found.start->push_back((moving[i] - start(fixed[i])).norm());
    found.after.push_back((moving[i] - fixed[i] - u).norm());
  }
  return found;
}

template <int Dim>
double active_share(const VectorVolume<Dim>& momentum) {
  const std::size_t sites = momentum.grid.voxels();
  std::size_t active = 0;
  for (std::size_t site = 0; site < sites; ++site) active += length(momentum, site) > 0;
  return static_cast<double>(active) / static_cast<double>(sites);
}

#define SALTUS_MEASURES(DIM)                                                                        \
  template JacobianMeasures measure_jacobian(const Volume<DIM>&);                                   \
  template DisplacementMeasures measure_displacement(const VectorVolume<DIM>&);                     \
  template std::optional<LandmarkMeasures> measure_landmarks(const ReportInput<DIM>&);              \
  template double active_share(const VectorVolume<DIM>&);
SALTUS_MEASURES(2)
SALTUS_MEASURES(3)
#undef SALTUS_MEASURES

}  // namespace saltus::report
