#pragma once

#include <array>
#include <functional>
#include <vector>

#include "core/grid/image_grid.h"

namespace saltus {

/// A branching tree of round vessels that fills an organ: each target point is joined to the nearest vessel, a little
/// towards the root, which makes a bifurcation there. Radii follow Murray's law, r^3 = sum of the children's r^3.
class VesselTree {
 public:
  struct Settings {
    double leaf_radius_mm = 0.9;
    double softness_mm = 1;   ///< half width of the wall's smooth edge
    double clearance_mm = 4;  ///< a target closer than this to a vessel is left out
  };

  /// Targets are joined in the given order, so coarse ones should come first. Where the way from a vessel to a target
  /// would leave the organ (`is_inside` is false on it), the target is left out.
  VesselTree(const Vector<3>& root, const std::vector<Vector<3>>& targets,
             const std::function<bool(const Vector<3>&)>& is_inside, const Settings& settings);

  /// Share of vessel at a point: 1 on the axis of a thick vessel, 0 outside, C1 between.
  double operator()(const Vector<3>& world) const;

  /// Where a vessel splits.
  const std::vector<Vector<3>>& branchings() const { return branchings_; }

 private:
  struct Segment {
    Vector<3> from, to;
    int parent = -1;
    double radius = 0;
    int leaves = 0;
  };

  bool join(const Vector<3>& target, const std::function<bool(const Vector<3>&)>& is_inside);
  void set_radii();
  void index_segments();

  Settings settings_;
  std::vector<Segment> segments_;
  std::vector<Vector<3>> branchings_;
  // Segments by cell of a regular lattice, in compressed rows.
  Vector<3> lattice_origin_;
  std::array<int, 3> lattice_size_{};
  std::vector<int> row_start_;
  std::vector<int> row_segments_;
};

}  // namespace saltus
