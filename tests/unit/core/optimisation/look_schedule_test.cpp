// When what is outside the working set is looked at. Oracle: the schedule that lbfgs.h states.
#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "core/optimisation/lbfgs.h"

namespace saltus {
namespace {

/// An ill-conditioned quadratic that goes on for long. Its last unknowns are outside the working set at first; one of
/// them joins at each of the given iterations, when that is one that looks.
class Growing final : public Objective<double> {
 public:
  /// `share`: of a range, that joins each time.
  explicit Growing(std::set<int> joins, std::size_t held = kSize - 4, double share = 0.1)
      : joins_(std::move(joins)), held_(held), share_(share) {}

  std::size_t size() const override { return held_; }
  bool has_more() const override { return true; }
  void look_everywhere(bool everywhere) override { looks_ = everywhere; }
  Evaluation evaluate(const std::vector<double>& x, std::vector<double>& gradient,
                      std::vector<double>& preconditioned) override {
    double value = 0;
    for (std::size_t i = 0; i < kSize; ++i) {
      const double difference = (i < held_ ? x[i] : 0) - 1, stiffness = std::pow(10.0, 0.06 * static_cast<double>(i));
      value += 0.5 * stiffness * difference * difference;
      if (i < held_) gradient[i] = stiffness * difference;
    }
    preconditioned = gradient;
    return {value, true};
  }
  double first_step(const std::vector<double>&) override { return 1e-7; }
  Revision revise(MinimiserState<double>& state) override {
    if (!looks_) return {};
    looked_at.push_back(state.iterations());
    if (joins_.count(state.iterations()) == 0) return {};
    ++held_;
    state.x.push_back(0);
    state.gradient.push_back(-std::pow(10.0, 0.06 * static_cast<double>(held_ - 1)));
    state.preconditioned.push_back(state.gradient.back());
    for (CurvaturePair<double>& pair : state.pairs)
      for (std::vector<double>* values : {&pair.s, &pair.y, &pair.y_preconditioned}) values->push_back(0);
    return {true, share_};
  }

  std::vector<int> looked_at;  ///< iterations after which it was asked for what was outside

 private:
  static constexpr std::size_t kSize = 120;
  std::set<int> joins_;
  std::size_t held_;
  double share_;
  bool looks_ = true;
};

MinimiseOptions long_run() {
  MinimiseOptions how;
  how.max_iterations = 160;
  how.tolerance = 0;
  how.history = 3;
  return how;
}

/// The iterations that looked; `states` gets the state after each step.
std::vector<int> looks(Growing objective, std::vector<MinimiserState<double>>* states = nullptr) {
  MinimiserState<double> state(std::vector<double>(objective.size(), 0.0));
  const MinimiseSummary summary = minimise<double>(objective, long_run(), state, [&](const MinimiseStep&) {
    if (states) states->push_back(state);
    return true;
  });
  EXPECT_EQ(summary.termination, MinimiseTermination::IterationLimit);
  return objective.looked_at;
}

TEST(LookSchedule, IsTwiceAsLongEachTimeUpToForty) {
  EXPECT_EQ(looks(Growing({})), (std::vector<int>{0, 5, 15, 35, 75, 115, 155}));
}

TEST(LookSchedule, StartsAgainOnceSomethingHasJoined) {
  EXPECT_EQ(looks(Growing({0})), (std::vector<int>{0, 5, 15, 35, 75, 115, 155}));
  EXPECT_EQ(looks(Growing({5})), (std::vector<int>{0, 5, 10, 20, 40, 80, 120, 160}));
  EXPECT_EQ(looks(Growing({35, 40, 50})), (std::vector<int>{0, 5, 15, 35, 40, 45, 55, 75, 115, 155}));
}

TEST(LookSchedule, GoesOnWhenHardlyAnythingJoins) {
  std::vector<MinimiserState<double>> states;
  EXPECT_EQ(looks(Growing({5, 15}, 100, 0.04), &states), (std::vector<int>{0, 5, 15, 35, 75, 115, 155}));
  EXPECT_EQ(states.back().x.size(), 102u) << "what joins is there all the same";
  EXPECT_EQ(looks(Growing({5}, 100, 0.06)), (std::vector<int>{0, 5, 10, 20, 40, 80, 120, 160}));
}

TEST(LookSchedule, StaysWhatItIsWhenTheRunIsTakenUpAgainFromAnyStep) {
  const std::set<int> joins = {15, 20};
  std::vector<MinimiserState<double>> states;
  const std::vector<int> whole = looks(Growing(joins), &states);
  ASSERT_EQ(whole, (std::vector<int>{0, 5, 15, 20, 25, 35, 55, 95, 135}));
  ASSERT_EQ(states.size(), 160u);
  for (MinimiserState<double>& state : states) {
    SCOPED_TRACE(state.iterations());
    const int from = state.iterations();
    Growing fresh(joins, state.x.size());
    minimise<double>(fresh, long_run(), state, [](const MinimiseStep&) { return true; });
    std::vector<int> left;
    for (int iteration : whole)
      if (iteration > from) left.push_back(iteration);
    EXPECT_EQ(fresh.looked_at, left);
  }
}

}  // namespace
}  // namespace saltus
