#include "server/worker/report/landmark_marks.h"

#include "core/drawing/colour_map.h"
#include "core/evaluation/field_sampling.h"

#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

namespace saltus::report {

using namespace drawing;

namespace {

template <int Dim>
bool is_shown(const ImageGrid<Dim>& grid, const SlicePlane<Dim>& plane, const Vector<Dim>& index) {
  const Vector<2> at = plane.picture_point(index, grid);
  if (!(at[0] >= 0 && at[0] <= plane.width && at[1] >= 0 && at[1] <= plane.height)) return false;
  if (plane.slice_axis < 0) return true;
  const double off = std::abs(index[plane.slice_axis] - plane.position[plane.slice_axis]);
  return off * grid.spacing[plane.slice_axis] <= landmark_reach_mm(grid, plane);
}

/// The radius of a ring in picture pixels, so that it has one size on the page whatever the picture's.
template <int Dim>
double ring_radius(const SlicePlane<Dim>& plane) {
  return std::max(plane.width, plane.height) / 90.0;
}

std::string ring(const Vector<2>& at, double radius) {
  char text[128];
  std::snprintf(text, sizeof text, "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"%.1f\"/>", at[0], at[1], radius);
  return text;
}

}  // namespace

template <int Dim>
double landmark_reach_mm(const ImageGrid<Dim>& fixed, const SlicePlane<Dim>& plane) {
  if (plane.slice_axis < 0) return std::numeric_limits<double>::infinity();
  const double spacing = fixed.spacing[plane.slice_axis];
  return std::max(spacing, fixed.size[plane.slice_axis] * spacing / 20);
}

template <int Dim>
LandmarkMarks fixed_landmark_marks(const ReportInput<Dim>& input, const SlicePlane<Dim>& plane) {
  const ImageGrid<Dim>& grid = input.input->fixed.grid;
  LandmarkMarks marks;
  for (const Vector<Dim>& point : input.fixed_points) {
    const Vector<Dim> index = grid.to_index(point);
    if (!is_shown(grid, plane, index)) continue;
    marks.svg += ring(plane.picture_point(index, grid), ring_radius(plane));
    ++marks.shown;
  }
  return marks;
}

template <int Dim>
LandmarkMarks carried_landmark_marks(const ReportInput<Dim>& input, const SlicePlane<Dim>& plane, double most_mm) {
  const ImageGrid<Dim>& grid = input.input->fixed.grid;
  const AffineMap<Dim>& start = input.input->start;
  const Matrix<Dim> back = start.linear.inverse();
  // The moving image is shown on the fixed grid, so a place of it goes back through the start.
  const auto index_of = [&](const Vector<Dim>& moving) { return grid.to_index(back * (moving - start.offset)); };
  const std::vector<Vector<Dim>> carried = transform_points(input.result->displacement, input.fixed_points);
  LandmarkMarks marks;
  for (std::size_t i = 0; i < carried.size(); ++i) {
    const Vector<Dim> there = index_of(input.moving_points[i]);
    if (!is_shown(grid, plane, there)) continue;
    const Vector<2> wanted = plane.picture_point(there, grid), found = plane.picture_point(index_of(carried[i]), grid);
    const Colour colour = interface_colour((carried[i] - input.moving_points[i]).norm() / most_mm);
    char text[256];
    std::snprintf(text, sizeof text,
                  "<g style=\"stroke:rgb(%d,%d,%d);fill:rgb(%d,%d,%d)\"><path d=\"M%.1f %.1fL%.1f %.1f\"/>", colour[0],
                  colour[1], colour[2], colour[0], colour[1], colour[2], wanted[0], wanted[1], found[0], found[1]);
    marks.svg += text;
    std::snprintf(text, sizeof text, "<circle class=\"dot\" cx=\"%.1f\" cy=\"%.1f\" r=\"%.1f\"/>", found[0], found[1],
                  ring_radius(plane) / 2.5);
    marks.svg += text + ring(wanted, ring_radius(plane)) + "</g>";
    ++marks.shown;
  }
  return marks;
}

#define SALTUS_INSTANTIATE(Dim)                                                                 \
  template double landmark_reach_mm(const ImageGrid<Dim>&, const SlicePlane<Dim>&);             \
  template LandmarkMarks fixed_landmark_marks(const ReportInput<Dim>&, const SlicePlane<Dim>&); \
  template LandmarkMarks carried_landmark_marks(const ReportInput<Dim>&, const SlicePlane<Dim>&, double);
SALTUS_INSTANTIATE(2)
SALTUS_INSTANTIATE(3)
#undef SALTUS_INSTANTIATE

}  // namespace saltus::report
