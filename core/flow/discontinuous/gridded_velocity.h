#pragma once

#include "core/flow/discontinuous/switching_sheet.h"

namespace saltus {

/// The velocity of a geodesic as a piecewise smooth field: linear between samples and between the time nodes over
/// [0,1], constant beyond the lattice, with the sheets of the first-order momenta as switching surfaces. One side is
/// made of the samples on it alone: in a cell that a sheet cuts, a corner on the other side (or nearer than the
/// sheet's clean distance) is replaced by a line along the sheet's axis through the next two samples on the own side.
/// Lattice, velocities and sheets are as GeodesicShooting and find_switching_sheets give them.
template <int Dim, class T>
class GriddedVelocity final : public PiecewiseVelocity<Dim> {
 public:
  /// `velocities` stay owned by the caller and must outlive this.
  GriddedVelocity(const Lattice<Dim>& lattice, const std::vector<Field<T>>& velocities,
                  std::vector<SwitchingSheet<Dim>> sheets);

  const Lattice<Dim>& lattice() const { return lattice_; }
  int surfaces() const override { return static_cast<int>(sheets_.size()); }
  SurfaceJet<Dim> surface(int which, double t, const Vector<Dim>& x) const override;
  VelocityJet<Dim> velocity(double t, const Vector<Dim>& x, const Sides& sides) const override;
  void surfaces_near(double t, const Vector<Dim>& x, double reach, std::vector<int>& found) const override;
  std::vector<double> time_breaks() const override;

 private:
  int node_before(double t, double& share) const;
  int block(int axis, double coordinate) const;
  const std::vector<int>& sheets_about(const Vector<Dim>& x) const;
  Vector<Dim> sample(int node, const Index<Dim>& index) const;
  Vector<Dim> sample_of_side(int node, const Index<Dim>& index, const Sides& sides, const std::vector<int>& near,
                             int left_out, int depth) const;

  Lattice<Dim> lattice_;
  const std::vector<Field<T>>& velocities_;
  std::vector<SwitchingSheet<Dim>> sheets_;
  Index<Dim> blocks_;
  std::vector<std::vector<int>> sheets_in_block_;
};

}  // namespace saltus
