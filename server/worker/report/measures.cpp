#include "server/worker/report/measures.h"

#include "core/evaluation/field_error.h"
#include "core/grid/lattice.h"
#include "core/support/errors.h"
#include "core/support/reduction.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace saltus::report {
namespace {

/// Lengths of a field's vectors, by voxel.
template <int Dim>
class Lengths {
 public:
  explicit Lengths(const VectorVolume<Dim>& field) {
    for (int c = 0; c < Dim; ++c) components_[c] = field.component(c);
  }
  double square(std::size_t voxel) const {
    double sum = 0;
    for (const float* component : components_) sum += std::pow(static_cast<double>(component[voxel]), 2);
    return sum;
  }
  double operator()(std::size_t voxel) const { return std::sqrt(square(voxel)); }

 private:
  std::array<const float*, Dim> components_;
};

}  // namespace

template <int Dim>
DisplacementMeasures measure_displacement(const VectorVolume<Dim>& displacement) {
  DisplacementMeasures found;
  const Lengths<Dim> length(displacement);
  const std::size_t voxels = displacement.grid.voxels();
  found.mean_mm = ordered_sum(voxels, length) / static_cast<double>(voxels);
  double most = 0;
#pragma omp parallel for schedule(static) reduction(max : most)
  for (std::size_t voxel = 0; voxel < voxels; ++voxel) most = std::max(most, length.square(voxel));
  found.max_mm = std::sqrt(most);
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
  const Lengths<Dim> length(momentum);
  const std::size_t sites = momentum.grid.voxels();
  std::size_t active = 0;
  for (std::size_t site = 0; site < sites; ++site) active += length(site) > 0;
  return static_cast<double>(active) / static_cast<double>(sites);
}

template <int Dim>
FoldedVoxels count_folded(const Volume<Dim>& jacobian, const DetectedInterface<Dim>& interface) {
  constexpr int reach = 2;
  const ImageGrid<Dim>& grid = jacobian.grid;
  FoldedVoxels found;
  std::vector<Index<Dim>> folds;
  Index<Dim> index{};
  const std::size_t voxels = grid.voxels();
  for (std::size_t voxel = 0; voxel < voxels; ++voxel) {
    bool is_inside = true;
    for (int a = 0; a < Dim; ++a)
      is_inside = is_inside && (grid.size[a] < 3 || (index[a] > 0 && index[a] + 1 < grid.size[a]));
    if (is_inside && !(jacobian.samples[voxel] > 0)) folds.push_back(index);
    for (int a = 0; a < Dim && ++index[a] == grid.size[a]; ++a) index[a] = 0;
  }
  found.n = found.off_interface = folds.size();
  if (folds.empty() || interface.faces.empty()) return found;

  const auto number = [&grid](const Index<Dim>& at) {
    std::size_t voxel = 0;
    for (int a = Dim - 1; a >= 0; --a)
      voxel = voxel * static_cast<std::size_t>(grid.size[a]) + static_cast<std::size_t>(at[a]);
    return voxel;
  };
  std::vector<bool> is_near(grid.voxels());
  for (const InterfaceFace<Dim>& face : interface.faces) {
    Index<Dim> first{}, last{};
    for (int a = 0; a < Dim; ++a) {
      first[a] = std::max(0, face.voxel[a] - reach + (a == face.axis ? 1 : 0));
      last[a] = std::min(grid.size[a] - 1, face.voxel[a] + reach);
    }
    for (Index<Dim> at = first;;) {
      is_near[number(at)] = true;
      int a = 0;
      while (a < Dim && at[a]++ == last[a]) at[a] = first[a], ++a;
      if (a == Dim) break;
    }
  }
  for (const Index<Dim>& fold : folds) found.off_interface -= is_near[number(fold)];
  return found;
}

template <int Dim>
double share_carried_beyond(const VectorVolume<Dim>& displacement, const ImageGrid<Dim>& other) {
  const ImageGrid<Dim>& grid = displacement.grid;
  const Lattice<Dim> lattice = lattice_of(grid);
  // x + u(x), as an index of the other grid: start + step * index of x + turn * u.
  const Matrix<Dim> turn = other.spacing.cwiseInverse().asDiagonal() * other.direction.transpose();
  const Matrix<Dim> step = turn * grid.direction * grid.spacing.asDiagonal();
  const Vector<Dim> start = turn * (grid.origin - other.origin);
  std::array<const float*, Dim> u;
  for (int c = 0; c < Dim; ++c) u[c] = displacement.component(c);
  std::size_t beyond = 0;
#pragma omp parallel for schedule(static) reduction(+ : beyond)
  for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab)
    visit_slab<Dim>(lattice, slab, [&](const Index<Dim>& index, std::size_t voxel) {
      bool is_beyond = false;
      for (int row = 0; row < Dim; ++row) {
        double place = start[row];
        for (int a = 0; a < Dim; ++a) place += step(row, a) * index[a] + turn(row, a) * u[a][voxel];
        is_beyond |= !(place > -0.5 - 1e-6 && place < other.size[row] - 0.5 + 1e-6);
      }
      beyond += is_beyond;
    });
  return static_cast<double>(beyond) / static_cast<double>(lattice.sites());
}

#define SALTUS_MEASURES(DIM)                                                             \
  template DisplacementMeasures measure_displacement(const VectorVolume<DIM>&);          \
  template std::optional<LandmarkMeasures> measure_landmarks(const ReportInput<DIM>&);   \
  template FoldedVoxels count_folded(const Volume<DIM>&, const DetectedInterface<DIM>&); \
  template double share_carried_beyond(const VectorVolume<DIM>&, const ImageGrid<DIM>&); \
  template double active_share(const VectorVolume<DIM>&);
SALTUS_MEASURES(2)
SALTUS_MEASURES(3)
#undef SALTUS_MEASURES

}  // namespace saltus::report
