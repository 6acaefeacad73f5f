#pragma once

#include "core/drawing/painting.h"
#include "core/drawing/raster.h"
#include "core/drawing/slice_plane.h"
#include "server/worker/report/measures.h"
#include "server/worker/report/report.h"

namespace saltus::report {

/// Paints slices of what a registration has read and found. Scales are chosen once, over the whole image, so that
/// slices and before/after pairs can be compared. Keeps a reference to the input.
template <int Dim>
class Pictures {
 public:
  /// `motion` is what was measured of the displacement.
  Pictures(const ReportInput<Dim>& input, const DisplacementMeasures& motion);

  drawing::Raster fixed(const drawing::SlicePlane<Dim>& plane) const;
  drawing::Raster moving(
      const drawing::SlicePlane<Dim>& plane) const;  ///< on the fixed grid, after the affine start alone
  drawing::Raster warped(const drawing::SlicePlane<Dim>& plane) const;
  drawing::Raster difference_before(const drawing::SlicePlane<Dim>& plane) const;  ///< moving - fixed
  drawing::Raster difference_after(const drawing::SlicePlane<Dim>& plane) const;   ///< warped - fixed
  drawing::Raster checkerboard(const drawing::SlicePlane<Dim>& plane) const;       ///< fixed and warped by turns
  drawing::Raster displacement(const drawing::SlicePlane<Dim>& plane) const;
  drawing::Raster jacobian(const drawing::SlicePlane<Dim>& plane) const;
  drawing::Raster momentum(const drawing::SlicePlane<Dim>& plane, std::size_t field) const;

  /// What the pictures are made of, at a continuous index of the fixed grid. Intensities in the window: 0 to 1.
  double fixed_at(const Vector<Dim>& index) const;
  double moving_at(const Vector<Dim>& index) const;
  double warped_at(const Vector<Dim>& index) const;
  double displacement_at(const Vector<Dim>& index) const;  ///< mm
  double jacobian_at(const Vector<Dim>& index) const;      ///< of the nearest voxel

  double difference_range() const { return difference_range_; }      ///< shares of the intensity window, each way
  double displacement_range() const { return displacement_range_; }  ///< mm
  double jacobian_range() const { return jacobian_range_; }          ///< the colours end at 1/range and range, > 1
  double momentum_range(std::size_t field) const { return momentum_ranges_[field]; }

 private:
  const ImageGrid<Dim>& grid() const { return input_.input->fixed.grid; }

  const ReportInput<Dim>& input_;
  drawing::IntensityWindow fixed_window_, moving_window_;
  double difference_range_ = 1, displacement_range_ = 1, jacobian_range_ = 2;
  std::vector<double> momentum_ranges_;
};

}  // namespace saltus::report
