#pragma once

#include "core/grid/volume.h"

#include <string>
#include <vector>

namespace saltus::drawing {

/// A flat picture through an image: which grid axis runs to the right and which down, at which scale. Pixels are square
/// in millimetres, so anisotropic voxels look right.
template <int Dim>
struct SlicePlane {
  std::string name;     ///< "" in 2-D; else "axial", "coronal", "sagittal", or the grid plane of an oblique image
  int right_axis = 0;   ///< grid axis along the picture's rows
  int down_axis = 1;    ///< grid axis along its columns
  int slice_axis = -1;  ///< the third axis, -1 in 2-D
  bool right_is_reversed = false;  ///< the picture runs against the grid axis
  bool down_is_reversed = false;
  Vector<Dim> position = Vector<Dim>::Zero();  ///< continuous index of a point of the plane
  int width = 0;                               ///< pixels
  int height = 0;
  double pixel_mm = 1;
  std::string right_label, left_label, top_label, bottom_label;  ///< "R", "L", "A", "P", "S", "I", or "" in 2-D

  /// Continuous index of a point of the picture; (0.5, 0.5) is the centre of the first pixel.
  Vector<Dim> index_at(double column, double row, const ImageGrid<Dim>& grid) const;
  /// The inverse, which drops the coordinate across the plane.
  Vector<2> picture_point(const Vector<Dim>& index, const ImageGrid<Dim>& grid) const;
};

/// The plane of a 2-D image; of a 3-D image the three orthogonal ones through the slices over which the gradient of u,
/// summed, is largest, so that they cut what moves differently from its neighbourhood. Radiological orientation. No
/// picture has more than `longest_side` pixels along an axis.
template <int Dim>
std::vector<SlicePlane<Dim>> choose_planes(const VectorVolume<Dim>& displacement, int longest_side = 512);

/// The same planes through the voxel `point` (a continuous index, rounded down).
template <int Dim>
std::vector<SlicePlane<Dim>> planes_through(const Vector<Dim>& point, const ImageGrid<Dim>& grid,
                                            int longest_side = 512);

}  // namespace saltus::drawing
