// Oracle: the same minimisation without an interruption.
#include <gtest/gtest.h>

#include <cmath>

#include "core/optimisation/lbfgs.h"

namespace saltus {
namespace {

/// A curved valley in many dimensions, with groups that sparsity keeps at zero.
class Valley final : public Objective<float> {
 public:
  std::size_t size() const override { return kSize; }
  Evaluation evaluate(const std::vector<float>& x, std::vector<float>& gradient,
                      std::vector<float>& preconditioned) override {
    if (evaluations_left-- == 0) throw 7;
    double value = 0;
    std::fill(gradient.begin(), gradient.end(), 0.0f);
    for (std::size_t i = 0; i + 1 < kSize; ++i) {
      const double a = 1 - x[i], b = x[i + 1] - x[i] * x[i];
      value += a * a + 10 * b * b;
      gradient[i] += static_cast<float>(-2 * a - 40 * x[i] * b);
      gradient[i + 1] += static_cast<float>(20 * b);
    }
    EXPECT_EQ(preconditioned.size(), kGroupsFrom);
    for (std::size_t i = 0; i < kGroupsFrom; ++i) preconditioned[i] = 0.05f * gradient[i];
    return {value, std::isfinite(value)};
  }
  double first_step(const std::vector<float>&) override { return 0.01; }
  const std::vector<GroupSparsity>& sparsity() const override { return sparsity_; }

  int evaluations_left = 1 << 30;

 private:
  static constexpr std::size_t kSize = 60, kGroupsFrom = 20;
  std::vector<GroupSparsity> sparsity_ = {{kGroupsFrom, kSize, 2, 1.5, 0.05, {}}};
};

MinimiseOptions options() {
  MinimiseOptions options;
  options.max_iterations = 60;
  options.tolerance = 1e-6;
  return options;
}

MinimiserState<float> start() { return MinimiserState<float>(std::vector<float>(60, -0.7f)); }

void expect_same(const MinimiserState<float>& a, const MinimiserState<float>& b) {
  EXPECT_EQ(a.x, b.x);
  EXPECT_EQ(a.gradient, b.gradient);
  EXPECT_EQ(a.energies, b.energies);
  EXPECT_EQ(a.evaluations, b.evaluations);
  EXPECT_EQ(a.pairs.size(), b.pairs.size());
}

TEST(MinimiserState, GoesOnFromAnyStepToTheSameEnd) {
  Valley valley;
  std::vector<MinimiserState<float>> states;
  MinimiserState<float> whole = start();
  const MinimiseSummary summary = minimise<float>(valley, options(), whole, [&](const MinimiseStep& step) {
    EXPECT_EQ(step.iteration, whole.iterations());
    EXPECT_EQ(step.energy, whole.energies.back());
    states.push_back(whole);
    return true;
  });
  ASSERT_GT(states.size(), 20u);
  EXPECT_EQ(summary.iterations, static_cast<int>(states.size()));
  for (std::size_t k = 0; k < states.size(); ++k) {
    SCOPED_TRACE(k);
    Valley fresh;
    int next = states[k].iterations();
    const MinimiseSummary again = minimise<float>(fresh, options(), states[k], [&](const MinimiseStep& step) {
      EXPECT_EQ(step.iteration, ++next);
      return true;
    });
    expect_same(states[k], whole);
    EXPECT_EQ(again.termination, summary.termination);
    EXPECT_EQ(again.iterations, summary.iterations);
    EXPECT_EQ(again.evaluations, summary.evaluations);
    EXPECT_EQ(again.energy_before, summary.energy_before);
    EXPECT_EQ(again.energy_after, summary.energy_after);
  }
}

// However an evaluation ends, what was accepted before it stands.
TEST(MinimiserState, IsThatOfTheLastAcceptedStepWhenTheObjectiveThrows) {
  Valley valley;
  MinimiserState<float> whole = start();
  minimise<float>(valley, options(), whole, [](const MinimiseStep&) { return true; });
  for (int evaluations : {5, 17, 40}) {
    SCOPED_TRACE(evaluations);
    Valley fragile;
    fragile.evaluations_left = evaluations;
    MinimiserState<float> state = start(), accepted;
    EXPECT_THROW(minimise<float>(fragile, options(), state,
                                 [&](const MinimiseStep&) {
                                   accepted = state;
                                   return true;
                                 }),
                 int);
    ASSERT_TRUE(accepted.has_begun());
    EXPECT_EQ(state.x, accepted.x);
    EXPECT_EQ(state.energies, accepted.energies);
    EXPECT_EQ(state.pairs.size(), accepted.pairs.size());
    Valley sound;
    minimise<float>(sound, options(), accepted, [](const MinimiseStep&) { return true; });
    expect_same(accepted, whole);
  }
}

TEST(MinimiserState, SaysWhyItEnded) {
  Valley valley;
  MinimiseOptions few = options();
  few.max_iterations = 3;
  MinimiserState<float> state = start();
  EXPECT_EQ(minimise<float>(valley, few, state, [](const MinimiseStep&) { return true; }).termination,
            MinimiseTermination::IterationLimit);
  EXPECT_EQ(state.iterations(), 3);
  few.max_iterations = 10;
  EXPECT_EQ(minimise<float>(valley, few, state, [](const MinimiseStep& s) { return s.iteration < 5; }).termination,
            MinimiseTermination::Stopped);
  EXPECT_EQ(state.iterations(), 5);
  few.max_iterations = 1000;
  few.tolerance = 0.5;
  EXPECT_EQ(minimise<float>(valley, few, state, [](const MinimiseStep&) { return true; }).termination,
            MinimiseTermination::Settled);
  few.optimality_tolerance = 1;
  EXPECT_EQ(minimise<float>(valley, few, state, [](const MinimiseStep&) { return true; }).termination,
            MinimiseTermination::Converged);
}

}  // namespace
}  // namespace saltus
