#include "core/phantom/vessel_tree.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace saltus {
namespace {

constexpr double kCellMm = 6;

double place_on_segment(const Vector<3>& from, const Vector<3>& to, const Vector<3>& point) {
  const Vector<3> along = to - from;
  return std::clamp((point - from).dot(along) / std::max(along.squaredNorm(), 1e-12), 0.0, 1.0);
}

double distance_to_segment(const Vector<3>& from, const Vector<3>& to, const Vector<3>& point) {
  return (from + place_on_segment(from, to, point) * (to - from) - point).norm();
}

}  // namespace

VesselTree::VesselTree(const Vector<3>& root, const std::vector<Vector<3>>& targets,
                       const std::function<bool(const Vector<3>&)>& is_inside, const Settings& settings)
    : settings_(settings) {
  for (const Vector<3>& target : targets) {
    if (segments_.empty()) {
      segments_.push_back({.from = root, .to = target});
      continue;
    }
    join(target, is_inside);
  }
  set_radii();
  index_segments();
}

bool VesselTree::join(const Vector<3>& target, const std::function<bool(const Vector<3>&)>& is_inside) {
  double nearest = std::numeric_limits<double>::infinity();
  int chosen = -1;
  for (std::size_t i = 0; i < segments_.size(); ++i) {
    const double distance = distance_to_segment(segments_[i].from, segments_[i].to, target);
    if (distance < nearest) {
      nearest = distance;
      chosen = static_cast<int>(i);
    }
  }
  if (nearest < settings_.clearance_mm) return false;

  const Segment upper = segments_[chosen];
  const double length = (upper.to - upper.from).norm();
  // Short pieces are not split again: their bifurcations could not be told apart.
  if (length < settings_.clearance_mm) return false;
  const double margin = std::min(0.45, 0.4 * settings_.clearance_mm / length);
  const double place = place_on_segment(upper.from, upper.to, target) - 0.3 * nearest / length;
  const Vector<3> joint = upper.from + std::clamp(place, margin, 1 - margin) * (upper.to - upper.from);
  for (int step = 0; step <= 10; ++step)
    if (!is_inside(joint + 0.1 * step * (target - joint))) return false;

  const int lower = static_cast<int>(segments_.size());
  for (Segment& segment : segments_)
    if (segment.parent == chosen) segment.parent = lower;
  segments_[chosen].to = joint;
  segments_.push_back({.from = joint, .to = upper.to, .parent = chosen});
  segments_.push_back({.from = joint, .to = target, .parent = chosen});
  branchings_.push_back(joint);
  return true;
}

void VesselTree::set_radii() {
  std::vector<bool> has_child(segments_.size(), false);
  for (const Segment& segment : segments_)
    if (segment.parent >= 0) has_child[segment.parent] = true;
  for (std::size_t i = 0; i < segments_.size(); ++i) {
    if (has_child[i]) continue;
    for (int up = static_cast<int>(i); up >= 0; up = segments_[up].parent) ++segments_[up].leaves;
  }
  for (Segment& segment : segments_) segment.radius = settings_.leaf_radius_mm * std::cbrt(segment.leaves);
}

void VesselTree::index_segments() {
  if (segments_.empty()) return;
  Vector<3> low = segments_.front().from, high = low;
  double widest = 0;
  for (const Segment& segment : segments_) {
    low = low.cwiseMin(segment.from).cwiseMin(segment.to);
    high = high.cwiseMax(segment.from).cwiseMax(segment.to);
    widest = std::max(widest, segment.radius);
  }
  const double reach = widest + settings_.softness_mm;
  lattice_origin_ = low - Vector<3>::Constant(reach);
  int cells = 1;
  for (int axis = 0; axis < 3; ++axis) {
    lattice_size_[axis] = static_cast<int>((high[axis] - low[axis] + 2 * reach) / kCellMm) + 1;
    cells *= lattice_size_[axis];
  }
  std::vector<std::vector<int>> rows(cells);
  for (std::size_t i = 0; i < segments_.size(); ++i) {
    const Segment& segment = segments_[i];
    const double radius = segment.radius + settings_.softness_mm;
    const Vector<3> first =
        (segment.from.cwiseMin(segment.to) - Vector<3>::Constant(radius) - lattice_origin_) / kCellMm;
    const Vector<3> last =
        (segment.from.cwiseMax(segment.to) + Vector<3>::Constant(radius) - lattice_origin_) / kCellMm;
    for (int z = static_cast<int>(first[2]); z <= static_cast<int>(last[2]); ++z)
      for (int y = static_cast<int>(first[1]); y <= static_cast<int>(last[1]); ++y)
        for (int x = static_cast<int>(first[0]); x <= static_cast<int>(last[0]); ++x) {
          const Vector<3> centre = lattice_origin_ + kCellMm * (Vector<3>(x, y, z) + Vector<3>::Constant(0.5));
          if (distance_to_segment(segment.from, segment.to, centre) <= radius + 0.87 * kCellMm)
            rows[(z * lattice_size_[1] + y) * lattice_size_[0] + x].push_back(static_cast<int>(i));
        }
  }
  row_start_.push_back(0);
  for (const auto& row : rows) {
    row_segments_.insert(row_segments_.end(), row.begin(), row.end());
    row_start_.push_back(static_cast<int>(row_segments_.size()));
  }
}

double VesselTree::operator()(const Vector<3>& world) const {
  const Vector<3> place = (world - lattice_origin_) / kCellMm;
  for (int axis = 0; axis < 3; ++axis)
    if (!(place[axis] >= 0 && place[axis] < lattice_size_[axis])) return 0;
  const int cell = (static_cast<int>(place[2]) * lattice_size_[1] + static_cast<int>(place[1])) * lattice_size_[0] +
                   static_cast<int>(place[0]);
  double share = 0;
  for (int k = row_start_[cell]; k < row_start_[cell + 1]; ++k) {
    const Segment& segment = segments_[row_segments_[k]];
    const double depth = segment.radius + settings_.softness_mm - distance_to_segment(segment.from, segment.to, world);
    const double t = std::clamp(depth / (2 * settings_.softness_mm), 0.0, 1.0);
    share = std::max(share, t * t * (3 - 2 * t));
  }
  return share;
}

}  // namespace saltus
