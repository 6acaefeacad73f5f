#include "core/registration/direction.h"

#include "core/registration/input_checks.h"
#include "core/support/errors.h"

#include <algorithm>
#include <cmath>
#include <sstream>

namespace saltus {
namespace {

/// Headers and pixels of some formats keep single precision or less.
constexpr double kUnitLength = 0.01;

bool is_unit(double length) { return std::abs(length - 1) <= kUnitLength; }

}  // namespace

template <int Dim>
Field<double> frame_directions(const RegistrationInput<Dim>& input, const RegistrationOptions& options) {
  const std::vector<double>& constant = options.momenta.direction;
  const bool has_field = input.direction.has_value();
  if (options.model != Model::Directional) {
    if (has_field || !constant.empty())
      throw InvalidInput("a direction is given and the model is " + to_string(options.model) +
                         "; only model directional has one, choose it or leave the direction out");
    return {};
  }
  if (!has_field && constant.empty())
    throw InvalidInput(
        "model directional has no direction; set parameter direction, such as direction=1,0,0, to the unit normal of "
        "the interface that slides, or give a field of them");
  if (has_field && !constant.empty())
    throw InvalidInput("there are a direction field and the parameter direction; give one of them");

  const ImageGrid<Dim>& grid = input.fixed.grid;
  const std::size_t voxels = grid.voxels();
  Field<double> w(Dim * voxels);
  const auto put = [&](std::size_t voxel, const Vector<Dim>& world) {
    const Vector<Dim> frame = grid.direction.transpose() * world.normalized();
    for (int c = 0; c < Dim; ++c) w[Dim * voxel + c] = frame[c];
  };
  if (!has_field) {
    if (constant.size() != Dim)
      throw InvalidInput("parameter direction has " + std::to_string(constant.size()) +
                         " components and the images have " + std::to_string(Dim) +
                         " dimensions; give one component for each");
    Vector<Dim> world;
    for (int c = 0; c < Dim; ++c) world[c] = constant[static_cast<std::size_t>(c)];
    for (std::size_t voxel = 0; voxel < voxels; ++voxel) put(voxel, world);
    return w;
  }

  const VectorVolume<Dim>& field = *input.direction;
  if (field.grid.size != grid.size || field.samples.size() != Dim * voxels)
    throw InvalidInput("the direction field and the fixed image have different sizes; resample the field");
  if (const double apart = largest_distance(field.grid, grid); !(apart <= kSamePlace * grid.spacing.minCoeff())) {
    std::ostringstream text;
    text << "the direction field lies up to " << apart << " mm from the fixed image; they must be on the same grid";
    throw InvalidInput(text.str());
  }
  bool is_somewhere = false;
  for (std::size_t voxel = 0; voxel < voxels; ++voxel) {
    Vector<Dim> world;
    for (int c = 0; c < Dim; ++c) world[c] = field.component(c)[voxel];
    const double length = world.norm();
    if (length == 0) continue;  // no first-order momentum here
    if (!is_unit(length)) {
      std::ostringstream text;
      text << "the direction field has a vector of length " << length << " at voxel " << voxel
           << "; vectors must have length 1, or 0 where nothing slides";
      throw InvalidInput(text.str());
    }
    put(voxel, world);
    is_somewhere = true;
  }
  if (!is_somewhere)
    throw InvalidInput("the direction field is 0 everywhere; it must be a unit normal where something may slide");
  return w;
}

template Field<double> frame_directions(const RegistrationInput<2>&, const RegistrationOptions&);
template Field<double> frame_directions(const RegistrationInput<3>&, const RegistrationOptions&);

}  // namespace saltus
