#include "core/registration/input_checks.h"

#include <Eigen/LU>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <sstream>

#include "core/grid/lattice.h"
#include "core/registration/finish.h"
#include "core/support/errors.h"

namespace saltus {
namespace {

template <int Dim>
void check_volume(const char* what, const Volume<Dim>& volume) {
  const std::vector<std::string> found = problems(volume.grid);
  if (!found.empty()) throw InvalidInput(std::string(what) + " image: " + found.front());
  if (volume.grid.voxels() == 1)
    throw InvalidInput(std::string(what) + " image has a single voxel; there is nothing to register");
  if (volume.samples.size() != volume.grid.voxels())
    throw InvalidInput(std::string(what) + " image has " + std::to_string(volume.samples.size()) +
                       " samples; its grid needs " + std::to_string(volume.grid.voxels()));
  const auto bad =
      std::find_if(volume.samples.begin(), volume.samples.end(), [](float v) { return !std::isfinite(v); });
  if (bad != volume.samples.end())
    throw InvalidInput(std::string(what) + " image holds a value that is not finite at voxel " +
                       std::to_string(bad - volume.samples.begin()) + "; replace NaN and Inf before registering");
}

template <int Dim>
void check_mask(const char* what, const std::optional<Volume<Dim>>& mask, const Volume<Dim>& image) {
  if (!mask) return;
  check_volume(what, *mask);
  if (mask->grid.size != image.grid.size)
    throw InvalidInput(std::string(what) + " is " + size_text<Dim>(mask->grid.size) + "; its image is " +
                       size_text<Dim>(image.grid.size) + ", they must be on the same grid");
  const double apart = largest_distance(mask->grid, image.grid);
  if (apart > kSamePlace * image.grid.spacing.minCoeff()) {
    std::ostringstream text;
    text << what << " lies up to " << apart << " mm from its image; resample it, they must be on the same grid";
    throw InvalidInput(text.str());
  }
  if (std::none_of(mask->samples.begin(), mask->samples.end(), [](float v) { return v > 0; }))
    throw InvalidInput(std::string(what) + " is 0 everywhere; it must be positive where the image counts");
}

template <int Dim>
void check_start(const AffineMap<Dim>& start) {
  if (!start.linear.allFinite() || !start.offset.allFinite())
    throw InvalidInput("the affine start holds a value that is not finite; give finite numbers or leave it out");
  if (!Eigen::FullPivLU<Matrix<Dim>>(start.linear).isInvertible())
    throw InvalidInput("the affine start has determinant 0; give a map that can be inverted or leave it out");
}

/// Some visible voxel of the fixed image must fall onto the moving image, or there is nothing to compare.
template <int Dim>
void check_overlap(const RegistrationInput<Dim>& input) {
  const ImageGrid<Dim>&fixed = input.fixed.grid, &moving = input.moving.grid;
  const AffineMap<Dim> to_moving = frame_to_index(input);
  const Lattice<Dim> lattice = lattice_of(fixed);
  std::atomic<bool> found = false;
#pragma omp parallel for schedule(static)
  for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab) {
    if (found) continue;
    visit_slab<Dim>(lattice, slab, [&](const Index<Dim>& index, std::size_t site) {
      if (input.fixed_mask && !(input.fixed_mask->samples[site] > 0)) return;
      Vector<Dim> at;
      for (int axis = 0; axis < Dim; ++axis) at[axis] = index[axis] * fixed.spacing[axis];
      const Vector<Dim> reached = to_moving(at);
      for (int axis = 0; axis < Dim; ++axis)
        if (!(reached[axis] >= -0.5 && reached[axis] <= moving.size[axis] - 0.5)) return;
      found = true;
    });
  }
  if (found) return;
  const auto corners = [](const ImageGrid<Dim>& grid) {
    Vector<Dim> last;
    for (int axis = 0; axis < Dim; ++axis) last[axis] = grid.size[axis] - 1;
    std::ostringstream text;
    const Vector<Dim> end = grid.to_world(last);
    for (int axis = 0; axis < Dim; ++axis) text << (axis ? " " : "(") << grid.origin[axis];
    for (int axis = 0; axis < Dim; ++axis) text << (axis ? " " : ") to (") << end[axis];
    return text.str() + ")";
  };
  throw InvalidInput("fixed and moving image do not overlap: they span " + corners(fixed) + " and " + corners(moving) +
                     " mm; check their origins and directions, or give an affine start");
}

}  // namespace

template <int Dim>
void check_input(const RegistrationInput<Dim>& input) {
  check_volume("fixed", input.fixed);
  check_volume("moving", input.moving);
  check_mask("fixed mask", input.fixed_mask, input.fixed);
  check_mask("moving mask", input.moving_mask, input.moving);
  check_start(input.start);
  check_overlap(input);
}

template void check_input(const RegistrationInput<2>&);
template void check_input(const RegistrationInput<3>&);

}  // namespace saltus
