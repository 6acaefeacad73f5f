#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace saltus {

/// Work done and to come, in sites evaluated, step by step. What a step takes shows only when it has ended: until it
/// begins the plan counts, from then on what was last expected of it, less what has been done since.
class WorkMeter {
 public:
  void plan_step(double work) { planned_.push_back(work); }
  /// Of a step that has not ended; of the one at hand: from now on.
  void expect(std::size_t step, double work) { planned_[step] = work; }
  void add(std::size_t step, double work) {
    done_ += work;
    planned_[step] = std::max(0.0, planned_[step] - work);
    look();
  }
  /// A step has ended: what it did not use will not come. A step that ended in an earlier run counts as it was planned.
  void end(std::size_t step, bool was_earlier = false) {
    if (was_earlier) done_ += planned_[step];
    planned_[step] = 0;
    look();
  }
  double left() const {
    double sum = 0;
    for (double work : planned_) sum += work;
    return sum;
  }
  /// Of all work, in [0, 1]. Never falls: where more comes than was expected it stands still.
  double fraction() const { return fraction_; }

 private:
  void look() {
    if (const double all = done_ + left(); all > 0) fraction_ = std::max(fraction_, done_ / all);
  }

  std::vector<double> planned_;  ///< still to come, by step
  double done_ = 0, fraction_ = 0;
};

}  // namespace saltus
