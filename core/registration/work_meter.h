#pragma once

#include <algorithm>
#include <vector>

namespace saltus {

/// Work done and to come, in units of voxel evaluations, step by step.
class WorkMeter {
 public:
  void plan_step(double work) { planned_until_.push_back((planned_until_.empty() ? 0 : planned_until_.back()) + work); }
  /// Line searches can take more than was planned: within a step the count stops at the step's end.
  void add(std::size_t step, double work) { done_ = std::min(done_ + work, planned_until_[step]); }
  /// A step has ended: what it did not use will not come.
  void end(std::size_t step) { done_ = planned_until_[step]; }
  double fraction() const { return planned_until_.back() > 0 ? std::min(1.0, done_ / planned_until_.back()) : 0; }

 private:
  std::vector<double> planned_until_;
  double done_ = 0;
};

}  // namespace saltus
