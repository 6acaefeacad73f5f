#include "core/drawing/slice_plane.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace saltus::drawing {
namespace {

/// Sum of |gradient of u| over each slice of each axis. Slices at the border are left out (zero), since what happens
/// there is seldom what one wants to see.
template <int Dim>
std::array<std::vector<double>, Dim> variation_of_slices(const VectorVolume<Dim>& u) {
  std::array<std::vector<double>, Dim> sums;
  for (int axis = 0; axis < Dim; ++axis) sums[axis].assign(u.grid.size[axis], 0.0);
  const int width = u.grid.size[0], height = Dim == 3 ? u.grid.size[1] : 1;
  std::vector<float> squares(static_cast<std::size_t>(width));
  for (int z = 0; z < u.grid.size[Dim - 1]; ++z)
    for (int y = 0; y < height; ++y) {
      const std::size_t first = (static_cast<std::size_t>(z) * height + y) * static_cast<std::size_t>(width);
      std::fill(squares.begin(), squares.end(), 0.0f);
      const auto add = [&](int count, std::size_t stride, double spacing) {
        const float per_mm = static_cast<float>(1 / spacing);
        for (int c = 0; c < Dim; ++c) {
          const float* at = u.component(c) + first;
          for (int x = 0; x < count; ++x) {
            const float slope = (at[x + stride] - at[x]) * per_mm;
            squares[x] += slope * slope;
          }
        }
      };
      add(width - 1, 1, u.grid.spacing[0]);
      if (Dim == 3 && y + 1 < height) add(width, static_cast<std::size_t>(width), u.grid.spacing[1]);
      if (z + 1 < u.grid.size[Dim - 1])
        add(width, static_cast<std::size_t>(width) * static_cast<std::size_t>(height), u.grid.spacing[Dim - 1]);
      double row = 0;
      for (int x = 0; x < width; ++x) {
        const double length = std::sqrt(squares[x]);
        sums[0][x] += length;
        row += length;
      }
      if constexpr (Dim == 3) sums[1][y] += row;
      sums[Dim - 1][z] += row;
    }
  for (int axis = 0; axis < Dim; ++axis) {
    const int border = u.grid.size[axis] / 10;
    std::fill_n(sums[axis].begin(), border, 0.0);
    std::fill_n(sums[axis].rbegin(), border, 0.0);
  }
  return sums;
}

template <int Dim>
Vector<Dim> point_of_interest(const VectorVolume<Dim>& displacement) {
  const auto sums = variation_of_slices(displacement);
  Vector<Dim> point;
  for (int axis = 0; axis < Dim; ++axis) {
    const auto most = std::max_element(sums[axis].begin(), sums[axis].end());
    point[axis] = *most > 0 ? static_cast<double>(most - sums[axis].begin()) : (displacement.grid.size[axis] - 1) / 2.0;
  }
  return point;
}

/// For each world axis the grid axis nearest to it, and whether they point against each other.
struct Orientation {
  std::array<int, 3> grid_axis{0, 1, 2};
  std::array<bool, 3> is_reversed{};
  bool is_anatomical = false;  ///< false: the image is too oblique to tell, the grid's own order is kept
};

Orientation orientation_of(const Matrix<3>& direction) {
  Orientation found;
  std::array<int, 3> nearest{};
  for (int axis = 0; axis < 3; ++axis) direction.col(axis).cwiseAbs().maxCoeff(&nearest[axis]);
  if (nearest[0] == nearest[1] || nearest[0] == nearest[2] || nearest[1] == nearest[2]) return found;
  found.is_anatomical = true;
  for (int axis = 0; axis < 3; ++axis) {
    found.grid_axis[nearest[axis]] = axis;
    found.is_reversed[nearest[axis]] = direction(nearest[axis], axis) < 0;
  }
  return found;
}

template <int Dim>
void set_size(SlicePlane<Dim>& plane, const ImageGrid<Dim>& grid, int longest_side) {
  const double wide = grid.size[plane.right_axis] * grid.spacing[plane.right_axis];
  const double high = grid.size[plane.down_axis] * grid.spacing[plane.down_axis];
  plane.pixel_mm = std::max({std::min(grid.spacing[plane.right_axis], grid.spacing[plane.down_axis]),
                             wide / longest_side, high / longest_side});
  plane.width = std::max(1, static_cast<int>(std::lround(wide / plane.pixel_mm)));
  plane.height = std::max(1, static_cast<int>(std::lround(high / plane.pixel_mm)));
}

std::vector<SlicePlane<2>> planes_at(const Vector<2>& point, const ImageGrid<2>& grid, int longest_side) {
  SlicePlane<2> plane;
  plane.position = point;
  set_size(plane, grid, longest_side);
  return {plane};
}

std::vector<SlicePlane<3>> planes_at(const Vector<3>& point, const ImageGrid<3>& grid, int longest_side) {
  // World axes (LPS) to the right and down: patient's left on the right, head at the top.
  struct View {
    const char* name;
    const char* grid_name;
    int right, down, across;
    bool down_is_reversed;
    const char *left_label, *right_label, *top_label, *bottom_label;
  };
  constexpr View views[] = {{"axial", "first and second axis", 0, 1, 2, false, "R", "L", "A", "P"},
                            {"coronal", "first and third axis", 0, 2, 1, true, "R", "L", "S", "I"},
                            {"sagittal", "second and third axis", 1, 2, 0, true, "A", "P", "S", "I"}};
  const Orientation orientation = orientation_of(grid.direction);
  std::vector<SlicePlane<3>> planes;
  for (const View& view : views) {
    SlicePlane<3> plane;
    plane.name = orientation.is_anatomical ? view.name : view.grid_name;
    plane.right_axis = orientation.grid_axis[view.right];
    plane.down_axis = orientation.grid_axis[view.down];
    plane.slice_axis = orientation.grid_axis[view.across];
    plane.right_is_reversed = orientation.is_reversed[view.right];
    plane.down_is_reversed = orientation.is_reversed[view.down] != view.down_is_reversed;
    plane.position = point;
    if (orientation.is_anatomical) {
      plane.left_label = view.left_label;
      plane.right_label = view.right_label;
      plane.top_label = view.top_label;
      plane.bottom_label = view.bottom_label;
    }
    set_size(plane, grid, longest_side);
    planes.push_back(plane);
  }
  return planes;
}

}  // namespace

template <int Dim>
Vector<Dim> SlicePlane<Dim>::index_at(double column, double row, const ImageGrid<Dim>& grid) const {
  Vector<Dim> index = position;
  const double x = right_is_reversed ? width - column : column, y = down_is_reversed ? height - row : row;
  index[right_axis] = x * pixel_mm / grid.spacing[right_axis] - 0.5;
  index[down_axis] = y * pixel_mm / grid.spacing[down_axis] - 0.5;
  return index;
}

template <int Dim>
Vector<2> SlicePlane<Dim>::picture_point(const Vector<Dim>& index, const ImageGrid<Dim>& grid) const {
  const double x = (index[right_axis] + 0.5) * grid.spacing[right_axis] / pixel_mm;
  const double y = (index[down_axis] + 0.5) * grid.spacing[down_axis] / pixel_mm;
  return {right_is_reversed ? width - x : x, down_is_reversed ? height - y : y};
}

template <int Dim>
std::vector<SlicePlane<Dim>> choose_planes(const VectorVolume<Dim>& displacement, int longest_side) {
  return planes_at(point_of_interest(displacement), displacement.grid, longest_side);
}

template <int Dim>
std::vector<SlicePlane<Dim>> planes_through(const Vector<Dim>& point, const ImageGrid<Dim>& grid, int longest_side) {
  return planes_at(Vector<Dim>(point.array().floor().matrix()), grid, longest_side);
}

template struct SlicePlane<2>;
template struct SlicePlane<3>;
template std::vector<SlicePlane<2>> choose_planes(const VectorVolume<2>&, int);
template std::vector<SlicePlane<3>> choose_planes(const VectorVolume<3>&, int);
template std::vector<SlicePlane<2>> planes_through(const Vector<2>&, const ImageGrid<2>&, int);
template std::vector<SlicePlane<3>> planes_through(const Vector<3>&, const ImageGrid<3>&, int);

}  // namespace saltus::drawing
