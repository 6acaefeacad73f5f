#include "core/evaluation/field_error.h"

#include <cmath>
#include <string>

#include "core/evaluation/field_sampling.h"
#include "core/evaluation/grid_agreement.h"
#include "core/support/errors.h"

namespace saltus {
namespace {

void require_pairs(std::size_t fixed, std::size_t moving) {
  if (fixed != moving)
    throw InvalidInput("the landmarks are " + std::to_string(fixed) + " fixed and " + std::to_string(moving) +
                       " moving points; they are matched by row, so both lists must have the same length.");
  if (fixed == 0) throw InvalidInput("the landmarks are empty; at least one pair is needed.");
}

}  // namespace

template <int Dim>
std::vector<double> landmark_errors(const VectorVolume<Dim>& displacement, const std::vector<Vector<Dim>>& fixed_points,
                                    const std::vector<Vector<Dim>>& moving_points) {
  return landmark_distances<Dim>(transform_points(displacement, fixed_points), moving_points);
}

template <int Dim>
std::vector<double> landmark_distances(const std::vector<Vector<Dim>>& fixed_points,
                                       const std::vector<Vector<Dim>>& moving_points) {
  require_pairs(fixed_points.size(), moving_points.size());
  std::vector<double> distances;
  for (std::size_t i = 0; i < fixed_points.size(); ++i)
    distances.push_back((fixed_points[i] - moving_points[i]).norm());
  return distances;
}

template <int Dim>
std::vector<double> endpoint_errors(const VectorVolume<Dim>& displacement, const VectorVolume<Dim>& truth,
                                    const std::optional<Volume<Dim>>& mask) {
  require_same_grid("the displacement", displacement.grid, "the truth", truth.grid);
  if (mask) require_same_grid("the displacement", displacement.grid, "the mask", mask->grid);
  std::vector<double> errors;
  for (std::size_t voxel = 0; voxel < displacement.grid.voxels(); ++voxel) {
    if (mask && !(mask->samples[voxel] > 0)) continue;
    double squared = 0;
    for (int c = 0; c < Dim; ++c) {
      const double difference =
          static_cast<double>(displacement.component(c)[voxel]) - static_cast<double>(truth.component(c)[voxel]);
      squared += difference * difference;
    }
    errors.push_back(std::sqrt(squared));
  }
  if (errors.empty()) throw InvalidInput("the mask is 0 everywhere; no endpoint error can be counted.");
  return errors;
}

#define SALTUS_INSTANTIATE(Dim)                                                                                      \
  template std::vector<double> landmark_errors(const VectorVolume<Dim>&, const std::vector<Vector<Dim>>&,            \
                                               const std::vector<Vector<Dim>>&);                                     \
  template std::vector<double> landmark_distances(const std::vector<Vector<Dim>>&, const std::vector<Vector<Dim>>&); \
  template std::vector<double> endpoint_errors(const VectorVolume<Dim>&, const VectorVolume<Dim>&,                   \
                                               const std::optional<Volume<Dim>>&);
SALTUS_INSTANTIATE(2)
SALTUS_INSTANTIATE(3)

}  // namespace saltus
