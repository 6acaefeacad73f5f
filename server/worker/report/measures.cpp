#include "server/worker/report/measures.h"

#include "core/evaluation/field_error.h"
#include "core/support/errors.h"

#include <algorithm>
#include <cmath>

namespace saltus::report {
namespace {

template <int Dim>
double length(const VectorVolume<Dim>& field, std::size_t voxel) {
  double sum = 0;
  for (int c = 0; c < Dim; ++c) sum += std::pow(static_cast<double>(field.component(c)[voxel]), 2);
  return std::sqrt(sum);
}

}  // namespace

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
  LandmarkMeasures found{
      landmark_distances(fixed, moving), {}, landmark_errors(input.result->displacement, fixed, moving), {}, 0};
  const auto& carried = input.result->moved_points;
  for (std::size_t i = 0; i < carried.size() && carried.size() == moving.size(); ++i) {
    if (carried[i].ending == TrajectoryEnd::Complete)
      found.particles.push_back((carried[i].position - moving[i]).norm());
    else
      ++found.particles_stopped;
  }
  if (start == AffineMap<Dim>{}) return found;
  std::vector<Vector<Dim>> started;
  for (const Vector<Dim>& point : fixed) started.push_back(start(point));
  found.start = landmark_distances(started, moving);
  return found;
}

template <int Dim>
double active_share(const VectorVolume<Dim>& momentum) {
  const std::size_t sites = momentum.grid.voxels();
  std::size_t active = 0;
  for (std::size_t site = 0; site < sites; ++site) active += length(momentum, site) > 0;
  return static_cast<double>(active) / static_cast<double>(sites);
}

#define SALTUS_MEASURES(DIM)                                                           \
  template DisplacementMeasures measure_displacement(const VectorVolume<DIM>&);        \
  template std::optional<LandmarkMeasures> measure_landmarks(const ReportInput<DIM>&); \
  template double active_share(const VectorVolume<DIM>&);
SALTUS_MEASURES(2)
SALTUS_MEASURES(3)
#undef SALTUS_MEASURES

}  // namespace saltus::report
