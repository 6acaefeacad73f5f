#include "client/cli/input_check.h"

#include "client/cli/result_files.h"
#include "core/image_io/points_io.h"
#include "core/image_io/read_image.h"
#include "core/support/errors.h"

#include <algorithm>
#include <cmath>
#include <sstream>

namespace saltus::cli {
namespace {

constexpr double much_larger = 10;
constexpr double little_overlap = 0.05;
constexpr double most_of_them = 0.9;

template <int Dim>
std::string spacing_text(const ImageGrid<Dim>& grid) {
  std::ostringstream text;
  for (int axis = 0; axis < Dim; ++axis) text << (axis ? " x " : "") << grid.spacing[axis];
  return text.str() + " mm";
}

/// World box around a grid: "x from -10 to 250, y from ... mm".
template <int Dim>
std::string box_text(const ImageGrid<Dim>& grid) {
  Vector<Dim> low = Vector<Dim>::Constant(HUGE_VAL), high = -low;
  for (int corner = 0; corner < (1 << Dim); ++corner) {
    Vector<Dim> index;
    for (int axis = 0; axis < Dim; ++axis) index[axis] = (corner >> axis & 1) ? grid.size[axis] - 1 : 0;
    const Vector<Dim> world = grid.to_world(index);
    low = low.cwiseMin(world);
    high = high.cwiseMax(world);
  }
  std::ostringstream text;
  text.precision(4);
  for (int axis = 0; axis < Dim; ++axis)
    text << (axis ? ", " : "") << "xyz"[axis] << " from " << low[axis] << " to " << high[axis];
  return text.str() + " mm";
}

template <int Dim>
bool is_inside(const Vector<Dim>& index, const ImageGrid<Dim>& grid) {
  for (int axis = 0; axis < Dim; ++axis)
    if (!(index[axis] >= -1 && index[axis] <= grid.size[axis])) return false;
  return true;
}

template <int Dim>
double share_inside(const std::vector<Vector<Dim>>& points, const ImageGrid<Dim>& grid) {
  std::size_t inside = 0;
  for (const Vector<Dim>& point : points) inside += is_inside<Dim>(grid.to_index(point), grid);
  return static_cast<double>(inside) / static_cast<double>(points.size());
}

template <int Dim>
std::vector<Vector<Dim>> with_other_axes(std::vector<Vector<Dim>> points) {
  for (Vector<Dim>& point : points) point.template head<2>() *= -1;
  return points;
}

/// Evenly spread over a grid.
template <int Dim>
std::vector<Vector<Dim>> places_in(const ImageGrid<Dim>& grid) {
  constexpr int along = 12;
  std::vector<Vector<Dim>> places;
  for (int number = 0; number < std::pow(along, Dim); ++number) {
    Vector<Dim> index;
    int rest = number;
    for (int axis = 0; axis < Dim; ++axis, rest /= along)
      index[axis] = (rest % along + 0.5) / along * grid.size[axis] - 0.5;
    places.push_back(grid.to_world(index));
  }
  return places;
}

template <int Dim>
void check(const JobOptions& options) {
  const auto is_allowed = [&](const std::string& name) {
    return std::find(options.allowed.begin(), options.allowed.end(), name) != options.allowed.end();
  };
  const auto refuse = [&](const std::string& name, const std::string& suspicion) {
    if (!suspicion.empty() && !is_allowed(name))
      throw InvalidInput(suspicion + " If it is meant so, add --allow " + name + ".");
  };
  const ImageGrid<Dim> fixed = read_grid<Dim>(options.fixed), moving = read_grid<Dim>(options.moving);
  refuse("spacing", spacing_suspicion(fixed, moving));
  // An affine start begins with centre on centre, wherever the images are.
  if (options.affine == "none") refuse("overlap", overlap_suspicion(fixed, moving));
  if (options.fixed_points.empty()) return;
  const std::string swapped = "the two landmark files seem to be swapped: exchange --fixed-points and --moving-points";
  const PointsPlace<Dim> places[] = {
      {"--fixed-points", "fixed image", fixed, moving, swapped, options.points_format},
      {"--moving-points", "moving image", moving, fixed, swapped, options.points_format}};
  const std::string* const files[] = {&options.fixed_points, &options.moving_points};
  for (int i = 0; i < 2; ++i)
    refuse("points",
           points_suspicion(read_points_as<Dim>(options.points_format, *files[i], places[i].grid), places[i]));
}

}  // namespace

template <int Dim>
std::string spacing_suspicion(const ImageGrid<Dim>& fixed, const ImageGrid<Dim>& moving) {
  const double ratio = std::pow(fixed.spacing.prod() / moving.spacing.prod(), 1.0 / Dim);
  if (std::max(ratio, 1 / ratio) < much_larger * (1 - 1e-9)) return "";
  return "The voxels of the fixed image are " + spacing_text(fixed) + " and those of the moving image " +
         spacing_text(moving) +
         ", ten times apart or more; is the spacing of one of them in cm, in m or not set? Correct its header.";
}

template <int Dim>
std::string overlap_suspicion(const ImageGrid<Dim>& fixed, const ImageGrid<Dim>& moving) {
  const auto places = places_in(fixed);
  if (share_inside(places, moving) >= little_overlap) return "";
  std::string text = "The images hardly lie in the same place: the fixed image spans " + box_text(fixed) +
                     ", the moving image " + box_text(moving) + ".";
  if (share_inside(with_other_axes(places), moving) >= 0.5)
    text += " With x and y of one of them negated they would: its header seems to mean RAS where LPS is written.";
  return text + " --affine rigid starts with the centre of one on the centre of the other.";
}

template <int Dim>
std::string points_suspicion(const std::vector<Vector<Dim>>& points, const PointsPlace<Dim>& place) {
  if (share_inside(points, place.grid) >= 0.5) return "";
  const auto inside = std::lround(share_inside(points, place.grid) * static_cast<double>(points.size()));
  std::string text = place.option + " has " + std::to_string(points.size()) + " points, of which " +
                     std::to_string(inside) + " lie in the " + place.image + "; ";
  const auto most_lie_in = [](const std::vector<Vector<Dim>>& tried, const ImageGrid<Dim>& grid) {
    return share_inside(tried, grid) >= most_of_them;
  };
  const bool is_ras = place.format.space == "ras", is_voxel = place.format.unit == "voxel";
  if (!is_voxel && most_lie_in(with_other_axes(points), place.grid))
    return text + (is_ras ? "as they stand in the file they do, so they seem to be LPS: leave --points-space ras out."
                          : "with x and y negated they do, so they seem to be RAS: add --points-space ras.");
  if (place.other && most_lie_in(points, *place.other)) return text + place.other_way + ".";
  std::vector<Vector<Dim>> in_other_unit;
  for (const Vector<Dim>& point : is_ras ? with_other_axes(points) : points)
    in_other_unit.push_back(is_voxel ? place.grid.to_index(point) : place.grid.to_world(point));
  if (most_lie_in(in_other_unit, place.grid)) {
    if (is_voxel) return text + "taken as world mm they do: leave --points-unit voxel out.";
    return text + "taken as voxel indices they do: " +
           (is_ras ? "give --points-unit voxel in place of --points-space ras." : "add --points-unit voxel.");
  }
  if (is_voxel)
    return text + "they must be voxel indices of that image, which has " + size_text<Dim>(place.grid.size) + " voxels.";
  return text + "they must be world mm (" + (is_ras ? "RAS" : "LPS") + ") of that image, which spans " +
         (is_ras ? "in LPS " : "") + box_text(place.grid) + ".";
}

void check_inputs(const JobOptions& options) {
  for (const std::string& name : options.allowed)
    if (name != "spacing" && name != "overlap" && name != "points")
      throw InvalidInput("--allow is " + name + "; it must be spacing, overlap or points");
  require_valid(options.points_format);
  try {
    const int fixed = image_dimension(options.fixed), moving = image_dimension(options.moving);
    if (fixed != moving)
      throw InvalidInput("--fixed has " + std::to_string(fixed) + " dimensions and --moving " + std::to_string(moving) +
                         "; both must have the same");
    fixed == 2 ? check<2>(options) : check<3>(options);
  } catch (const FileError&) {
    // What cannot be read is refused by the worker, which reads everything and has a reason for each case.
  }
}

void refuse_inputs_among_results(const JobOptions& options, const std::filesystem::path& out) {
  for (const auto& [option, file] : {std::pair("--fixed", &options.fixed),
                                     {"--moving", &options.moving},
                                     {"--fixed-mask", &options.fixed_mask},
                                     {"--moving-mask", &options.moving_mask}})
    if (!file->empty()) refuse_input_among_results(option, *file, out);
}

#define SALTUS_INPUT_CHECK(DIM)                                                         \
  template std::string spacing_suspicion(const ImageGrid<DIM>&, const ImageGrid<DIM>&); \
  template std::string overlap_suspicion(const ImageGrid<DIM>&, const ImageGrid<DIM>&); \
  template std::string points_suspicion(const std::vector<Vector<DIM>>&, const PointsPlace<DIM>&);
SALTUS_INPUT_CHECK(2)
SALTUS_INPUT_CHECK(3)
#undef SALTUS_INPUT_CHECK

}  // namespace saltus::cli
