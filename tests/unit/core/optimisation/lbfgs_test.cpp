// Oracle: problems whose solution is known in closed form.
#include "core/optimisation/lbfgs.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "core/support/errors.h"

namespace saltus {
namespace {

/// A smooth function and its gradient, with a diagonal preconditioner and a first step of the caller's choice.
template <class T>
class Function : public Objective<T> {
 public:
  using Evaluate = std::function<double(const std::vector<T>& x, std::vector<T>& gradient)>;
  Function(std::size_t size, Evaluate evaluate) : preconditioner(size, T(1)), evaluate_(std::move(evaluate)) {}

  std::size_t size() const override { return preconditioner.size(); }
  Evaluation evaluate(const std::vector<T>& x, std::vector<T>& gradient, std::vector<T>& preconditioned) override {
    const double value = evaluate_(x, gradient);
    std::size_t dense = 0;  // outside the groups
    for (std::size_t i = 0; i < x.size(); ++i)
      if (std::none_of(groups.begin(), groups.end(),
                       [i](const auto& range) { return i >= range.begin && i < range.end; }))
        preconditioned[dense++] = preconditioner[i] * gradient[i];
    EXPECT_EQ(dense, preconditioned.size());
    return {value, std::isfinite(value)};
  }
  double first_step(const std::vector<T>&) override { return step; }
  const std::vector<GroupSparsity>& sparsity() const override { return groups; }

  std::vector<T> preconditioner;
  std::vector<GroupSparsity> groups;
  double step = 1;

 private:
  Evaluate evaluate_;
};

/// 1/2 sum_i h_i (x_i - c_i)^2.
template <class T>
Function<T> separable(const std::vector<double>& stiffness, const std::vector<double>& centre) {
  return Function<T>(centre.size(), [=](const std::vector<T>& x, std::vector<T>& gradient) {
    double value = 0;
    for (std::size_t i = 0; i < x.size(); ++i) {
      gradient[i] = static_cast<T>(stiffness[i] * (x[i] - centre[i]));
      value += 0.5 * stiffness[i] * (x[i] - centre[i]) * (x[i] - centre[i]);
    }
    return value;
  });
}

MinimiseOptions to_the_end(int iterations = 500) {
  MinimiseOptions options;
  options.max_iterations = iterations;
  options.tolerance = 0;
  return options;
}

const auto go_on = [](const MinimiseStep&) { return true; };

/// Collects what is accepted and checks that the energy never rises.
struct Witness {
  std::vector<MinimiseStep> steps;
  bool operator()(const MinimiseStep& step) {
    if (!steps.empty()) {
      EXPECT_LE(step.energy, steps.back().energy);
    }
    EXPECT_EQ(step.iteration, static_cast<int>(steps.size()) + 1);
    steps.push_back(step);
    return true;
  }
};

TEST(Minimise, SolvesACoupledQuadratic) {
  // 1/2 x.Ax - b.x, A tridiagonal (2, -1) plus 0.01: b is made from the wanted solution.
  constexpr std::size_t n = 40;
  std::vector<double> wanted(n), b(n);
  for (std::size_t i = 0; i < n; ++i) wanted[i] = std::sin(0.4 * i) + 0.1 * i;
  const auto apply = [](const std::vector<double>& x, std::size_t i) {
    return 2.01 * x[i] - (i > 0 ? x[i - 1] : 0) - (i + 1 < n ? x[i + 1] : 0);
  };
  for (std::size_t i = 0; i < n; ++i) b[i] = apply(wanted, i);
  Function<double> objective(n, [&](const std::vector<double>& x, std::vector<double>& gradient) {
    double value = 0;
    for (std::size_t i = 0; i < n; ++i) {
      const double ax = apply(x, i);
      gradient[i] = ax - b[i];
      value += 0.5 * x[i] * ax - b[i] * x[i];
    }
    return value;
  });
  std::vector<double> x(n, 0.0);
  Witness witness;
  const MinimiseSummary summary = minimise<double>(objective, to_the_end(), x, std::ref(witness));
  for (std::size_t i = 0; i < n; ++i) EXPECT_NEAR(x[i], wanted[i], 1e-5);
  ASSERT_FALSE(witness.steps.empty());
  EXPECT_EQ(summary.iterations, witness.steps.back().iteration);
  EXPECT_EQ(summary.energy_after, witness.steps.back().energy);
  EXPECT_EQ(summary.energy_before, 0);
  EXPECT_GT(summary.evaluations, summary.iterations);
}

TEST(Minimise, FollowsTheValleyOfRosenbrock) {
  Function<double> objective(2, [](const std::vector<double>& x, std::vector<double>& gradient) {
    const double a = 1 - x[0], b = x[1] - x[0] * x[0];
    gradient = {-2 * a - 400 * x[0] * b, 200 * b};
    return a * a + 100 * b * b;
  });
  objective.step = 1e-3;
  std::vector<double> x = {-1.2, 1.0};
  Witness witness;
  minimise<double>(objective, to_the_end(), x, std::ref(witness));
  EXPECT_NEAR(x[0], 1, 1e-5);
  EXPECT_NEAR(x[1], 1, 1e-5);
  EXPECT_LT(witness.steps.size(), 100u);
}

/// 5 |x| + (y - 1)^2, whose slope at x = 0 is that of the upper side, or the mean of both.
class Kink : public Function<double> {
 public:
  explicit Kink(bool has_mean) : Function<double>(2, upper), has_mean_(has_mean) {}
  Evaluation evaluate_between_sides(const std::vector<double>& x, std::vector<double>& gradient,
                                    std::vector<double>& preconditioned) override {
    ++asked;
    const Evaluation found = evaluate(x, gradient, preconditioned);
    if (has_mean_ && x[0] == 0) gradient[0] = preconditioned[0] = 0;
    return found;
  }
  int asked = 0;

 private:
  static double upper(const std::vector<double>& x, std::vector<double>& gradient) {
    gradient = {x[0] >= 0 ? 5.0 : -5.0, 2 * (x[1] - 1)};
    return 5 * std::abs(x[0]) + (x[1] - 1) * (x[1] - 1);
  }
  bool has_mean_;
};

TEST(Minimise, LeavesAKinkBetweenItsSides) {
  for (const bool has_mean : {false, true}) {
    Kink kink(has_mean);
    std::vector<double> x = {0, 0};
    Witness witness;
    const MinimiseSummary summary = minimise<double>(kink, to_the_end(), x, std::ref(witness));
    EXPECT_GE(kink.asked, 1);
    EXPECT_EQ(x[0], 0);
    if (has_mean) {
      EXPECT_NEAR(x[1], 1, 1e-6);
      EXPECT_GT(summary.iterations, 0);
      continue;
    }
    EXPECT_EQ(summary.termination, MinimiseTermination::LineSearchFailed);
    EXPECT_EQ(summary.iterations, 0);
    EXPECT_EQ(x[1], 0);
  }
}

// The mean's slope leads far too far at first. Twenty times too far is found back from in three steps (2 t of 40, 4 and
// then, where the parabola through those is least, 1/2); two hundred times is not.
TEST(Minimise, TriesThreeStepsFromAKink) {
  for (const double step : {40.0, 400.0}) {
    Kink kink(true);
    kink.step = step;
    std::vector<double> x = {0, 0};
    Witness witness;
    const MinimiseSummary summary = minimise<double>(kink, to_the_end(), x, std::ref(witness));
    EXPECT_EQ(x[0], 0);
    EXPECT_NEAR(x[1], step == 40 ? 1 : 0, 1e-6);
    if (step != 40) {
      EXPECT_EQ(summary.termination, MinimiseTermination::LineSearchFailed);
    }
  }
}

// 5 |x| + 5 |y| - 2 y is least at its kink, though the mean of both sides has a slope there.
TEST(Minimise, StaysAtTheBottomOfAKinkWithoutLookingForLong) {
  class Bottom : public Function<double> {
   public:
    Bottom()
        : Function<double>(2, [](const std::vector<double>& x, std::vector<double>& gradient) {
            gradient = {x[0] >= 0 ? 5.0 : -5.0, x[1] >= 0 ? 3.0 : -7.0};
            return 5 * std::abs(x[0]) + 5 * std::abs(x[1]) - 2 * x[1];
          }) {}
    Evaluation evaluate_between_sides(const std::vector<double>& x, std::vector<double>& gradient,
                                      std::vector<double>& preconditioned) override {
      const Evaluation found = evaluate(x, gradient, preconditioned);
      gradient = preconditioned = {0, -2};
      return found;
    }
  } bottom;
  std::vector<double> x = {0, 0};
  const MinimiseOptions options = to_the_end();
  const MinimiseSummary summary = minimise<double>(bottom, options, x, go_on);
  EXPECT_EQ(x, (std::vector<double>{0, 0}));
  EXPECT_EQ(summary.termination, MinimiseTermination::LineSearchFailed);
  // The start, steps along the upper side's slope, the mean, and a few along that.
  EXPECT_GT(summary.evaluations, 1 + options.max_line_search + 1);
  EXPECT_LE(summary.evaluations, 1 + options.max_line_search + 1 + 3);
}

// -x - 0.1 log(1 - x) ends at x = 0.9; from 1 on it is not a number, and the first step lands far beyond.
TEST(Minimise, ShortensStepsThatLeaveWhereTheEnergyExists) {
  for (double nothing :
       {std::nan(""), std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()}) {
    Function<double> objective(1, [&](const std::vector<double>& x, std::vector<double>& gradient) {
      if (x[0] >= 1) {
        gradient[0] = std::nan("");
        return nothing;
      }
      gradient[0] = -1 + 0.1 / (1 - x[0]);
      return -x[0] - 0.1 * std::log(1 - x[0]);
    });
    objective.step = 1000;
    std::vector<double> x = {0.0};
    Witness witness;
    minimise<double>(objective, to_the_end(), x, std::ref(witness));
    EXPECT_NEAR(x[0], 0.9, 1e-5);
  }
}

// The energy is a number everywhere, but from 1 on its slope is none: nothing can be said about such a point.
TEST(Minimise, ShortensStepsThatLeaveWhereTheGradientExists) {
  Function<double> objective(1, [](const std::vector<double>& x, std::vector<double>& gradient) {
    gradient[0] = x[0] < 1 ? x[0] - 0.9 : std::nan("");
    return 0.5 * (x[0] - 0.9) * (x[0] - 0.9);
  });
  objective.step = 1.9;  // to 1.71, where the energy is less than at 0
  std::vector<double> x = {0.0};
  Witness witness;
  minimise<double>(objective, to_the_end(), x, std::ref(witness));
  EXPECT_NEAR(x[0], 0.9, 1e-5);
}

// Closed form: x_g = c_g max(0, 1 - lambda / (h |c_g|)).
template <class T>
void expect_soft_thresholds(double tolerance) {
  const std::size_t groups = 30, group = 3, smooth = 4, n = smooth + groups * group;
  const double lambda = 1.5, h = 2;
  std::vector<double> stiffness(n, h), centre(n);
  for (std::size_t i = 0; i < n; ++i) centre[i] = std::sin(1.7 * i) * 0.08 * (i % 17);
  auto objective = separable<T>(stiffness, centre);
  objective.groups = {{smooth, n, static_cast<int>(group), lambda, 1 / h, {}}};
  for (std::size_t i = smooth; i < n; ++i) objective.preconditioner[i] = static_cast<T>(1 / h);
  for (bool from_zero : {true, false}) {
    std::vector<T> x(n, T(0));
    if (!from_zero)
      for (std::size_t i = 0; i < n; ++i) x[i] = static_cast<T>(0.3 + 0.1 * (i % 5));
    Witness witness;
    minimise<T>(objective, to_the_end(), x, std::ref(witness));
    int zeros = 0;
    for (std::size_t i = 0; i < smooth; ++i) EXPECT_NEAR(x[i], centre[i], tolerance);
    for (std::size_t at = smooth; at < n; at += group) {
      const double size = std::hypot(centre[at], centre[at + 1], centre[at + 2]);
      const double keep = std::max(0.0, 1 - lambda / (h * size));
      zeros += keep == 0;
      for (std::size_t k = at; k < at + group; ++k)
        if (keep == 0) {
          EXPECT_EQ(x[k], T(0)) << "group at " << at << (from_zero ? " from zero" : " from elsewhere");
        } else
          EXPECT_NEAR(x[k], keep * centre[k], tolerance);
    }
    EXPECT_GT(zeros, 5);
    EXPECT_LT(zeros, 25);
    double norms = 0;
    for (std::size_t at = smooth; at < n; at += group) norms += std::hypot(x[at], x[at + 1], x[at + 2]);
    EXPECT_NEAR(witness.steps.back().sparsity, lambda * norms, 1e-5);
  }
}

TEST(Minimise, FindsSoftThresholdsWithExactZerosInDouble) { expect_soft_thresholds<double>(1e-6); }
TEST(Minimise, FindsSoftThresholdsWithExactZerosInFloat) { expect_soft_thresholds<float>(1e-3); }

// Oracle: soft thresholds, as above. With pairs of the same smooth part under another weight it gets there sooner, and
// does not ask how long a first step should be.
TEST(Minimise, GoesOnWithTheCurvatureOfARunWithAnotherWeight) {
  const std::vector<double> stiffness = {1, 3, 9, 27, 81}, centre = {2, -1, 0.8, 0.6, -0.5};
  auto function = separable<double>(stiffness, centre);
  const auto minimised = [&](double weight, MinimiserState<double>& state) {
    function.groups = {{0, 5, 1, weight, 1, {}}};
    MinimiseOptions how = to_the_end();
    how.optimality_reference = 1;
    how.optimality_tolerance = 1e-9;
    return minimise<double>(function, how, state, go_on).iterations;
  };
  MinimiserState<double> before(std::vector<double>(5, 0.0));
  minimised(0.5, before);
  MinimiserState<double> plain(before.x), informed(before.x);
  informed.pairs = before.pairs;
  ASSERT_GT(informed.pairs.size(), 2u);
  function.step = 1e-3;
  const int without = minimised(0.1, plain), with = minimised(0.1, informed);
  EXPECT_LT(with, without);
  for (std::size_t i = 0; i < 5; ++i) {
    const double size = std::max(0.0, std::abs(centre[i]) - 0.1 / stiffness[i]);
    EXPECT_NEAR(informed.x[i], std::copysign(size, centre[i]), 1e-7);
  }
}

TEST(Minimise, LeavesZeroAloneWhenTheWeightHoldsEveryGroup) {
  auto objective = separable<double>({1, 1, 1, 1}, {0.3, -0.4, 0.1, 0.2});
  objective.groups = {{0, 4, 2, 0.51, 1, {}}};  // the longest gradient is 0.5
  std::vector<double> x(4, 0.0);
  const MinimiseSummary summary = minimise<double>(objective, to_the_end(), x, go_on);
  EXPECT_EQ(x, std::vector<double>(4, 0.0));
  EXPECT_EQ(summary.termination, MinimiseTermination::Converged);
  EXPECT_EQ(summary.iterations, 0);
  EXPECT_EQ(summary.evaluations, 1);
}

TEST(Minimise, RefusesToKeepNoPair) {
  Function<double> objective(1, [](const std::vector<double>& x, std::vector<double>& gradient) {
    gradient[0] = x[0];
    return 0.5 * x[0] * x[0];
  });
  MinimiseOptions options;
  options.history = 0;
  std::vector<double> x(1, 1.0);
  EXPECT_THROW(minimise<double>(objective, options, x, [](const MinimiseStep&) { return true; }), std::logic_error);
}

// What a look at the noise forgets would be what wants to join.
TEST(Minimise, RefusesToLookAtTheNoiseWhereThereIsMoreToJoin) {
  class Growing final : public Function<double> {
   public:
    using Function::Function;
    bool has_more() const override { return true; }
  };
  Growing objective(1, [](const std::vector<double>& x, std::vector<double>& gradient) {
    gradient[0] = x[0] - 1;
    return 0.5 * gradient[0] * gradient[0];
  });
  MinimiseOptions options = to_the_end();
  std::vector<double> x(1, 0.0);
  const auto go_on = [](const MinimiseStep&) { return true; };
  EXPECT_NO_THROW(minimise<double>(objective, options, x, go_on));
  options.noise_tolerance = 0.1;
  x = {0};
  EXPECT_THROW(minimise<double>(objective, options, x, go_on), std::logic_error);
}

// Pairs are rounded when they are stored, and only what is stored is a model of the curvature that is positive
// definite.
TEST(Minimise, KnowsTheCurvatureOfThePairsAsTheyAreStored) {
  const std::vector<double> stiffness = {1, 3.7, 0.21, 12.9, 5.3}, centre = {1.1, -2.3, 0.7, 3.3, -0.9};
  Function<float> objective = separable<float>(stiffness, centre);
  MinimiserState<float> state(std::vector<float>(5, 0.0f));
  minimise<float>(objective, to_the_end(6), state, [](const MinimiseStep&) { return true; });
  ASSERT_GE(state.pairs.size(), 3u);
  double rounded = 0;
  for (const CurvaturePair<float>& pair : state.pairs) {
    double product = 0;
    for (std::size_t i = 0; i < 5; ++i) {
      product += double(float(pair.s[i])) * double(float(pair.y[i]));
      rounded = std::max(rounded, std::abs(float(pair.y[i]) / (stiffness[i] * float(pair.s[i])) - 1));
    }
    EXPECT_NEAR(pair.rho * product, 1, 1e-12);
  }
  EXPECT_GT(rounded, 1e-4);  // else nothing was
}

// From pairs of a bowl on to a hill: a step down the hill sees no curvature.
TEST(Minimise, KeepsNoPairWithoutCurvature) {
  const std::vector<double> stiffness = {1, 4, 9}, centre = {1, -2, 3};
  Function<double> bowl = separable<double>(stiffness, centre), hill = separable<double>({-1, -4, -9}, centre);
  MinimiserState<double> before(std::vector<double>(3, 0.0));
  MinimiseOptions options = to_the_end(4);
  options.history = 2;
  minimise<double>(bowl, options, before, [](const MinimiseStep&) { return true; });
  ASSERT_EQ(before.pairs.size(), 2u);
  options.max_iterations = 1;
  for (int history : {2, 3}) {
    options.history = history;
    MinimiserState<double> state(std::vector<double>{0.9, -2.1, 3.2});
    state.pairs = before.pairs;
    const MinimiseSummary found = minimise<double>(hill, options, state, [](const MinimiseStep&) { return true; });
    EXPECT_EQ(found.iterations, 1);
    EXPECT_LT(found.energy_after, found.energy_before);
    ASSERT_EQ(state.pairs.size(), history == 2 ? 1u : 2u);  // the newest stays
    EXPECT_EQ(state.pairs.back().s, before.pairs.back().s);
    EXPECT_EQ(state.pairs.back().rho, before.pairs.back().rho);
  }
}

TEST(Minimise, StopsWhenTheCallerSaysSoAndKeepsTheLastAcceptedPoint) {
  auto objective = separable<double>({1, 10, 100, 1000}, {1, 2, 3, 4});
  objective.step = 1e-3;
  std::vector<double> x(4, 0.0);
  double last = 0;
  const MinimiseSummary summary = minimise<double>(objective, to_the_end(), x, [&](const MinimiseStep& step) {
    last = step.energy;
    return step.iteration < 3;
  });
  EXPECT_EQ(summary.termination, MinimiseTermination::Stopped);
  EXPECT_EQ(summary.iterations, 3);
  std::vector<double> gradient(4), preconditioned(4);
  EXPECT_DOUBLE_EQ(objective.evaluate(x, gradient, preconditioned).value, last);
}

TEST(Minimise, SaysHowItEnded) {
  auto objective = separable<double>({1, 10, 100, 1000}, {1, 2, 3, 4});
  objective.step = 1e-4;
  std::vector<double> x(4, 0.0);
  EXPECT_EQ(minimise<double>(objective, to_the_end(2), x, go_on).termination, MinimiseTermination::IterationLimit);
  MinimiseOptions loose;
  loose.max_iterations = 500;
  loose.tolerance = 0.5;
  x.assign(4, 0.0);
  const MinimiseSummary early = minimise<double>(objective, loose, x, go_on);
  EXPECT_EQ(early.termination, MinimiseTermination::Settled);
  EXPECT_LT(early.iterations, 20);
  MinimiseOptions near = to_the_end();
  near.optimality_tolerance = 0.1;
  x.assign(4, 0.0);
  const MinimiseSummary residual = minimise<double>(objective, near, x, go_on);
  EXPECT_EQ(residual.termination, MinimiseTermination::Converged);
  EXPECT_LE(residual.optimality, 0.1);
  EXPECT_GT(residual.optimality, 0);
  // A gradient that points the wrong way: nothing along it decreases, so the point stays.
  Function<double> uphill(1, [](const std::vector<double>& x, std::vector<double>& gradient) {
    gradient[0] = -1;
    return x[0];
  });
  std::vector<double> start = {2.0};
  EXPECT_EQ(minimise<double>(uphill, to_the_end(), start, go_on).termination, MinimiseTermination::LineSearchFailed);
  EXPECT_EQ(start[0], 2.0);
  x.assign(4, 0.0);
  const MinimiseSummary none = minimise<double>(objective, to_the_end(0), x, go_on);
  EXPECT_EQ(none.termination, MinimiseTermination::IterationLimit);
  EXPECT_EQ(none.energy_after, none.energy_before);
}

TEST(Minimise, KnowsWhatHasSettled) {
  const std::vector<double> energies = {30, 20, 14, 13, 12, 11, 10};  // the last five took 10 of 20
  EXPECT_TRUE(has_settled(energies, 0, 0.5));
  EXPECT_FALSE(has_settled(energies, 0, 0.49));
  EXPECT_TRUE(has_settled(energies, 80, 0.1)) << "of 100 in all";
  EXPECT_FALSE(has_settled(energies, 80, 0.09));
  EXPECT_TRUE(has_settled({2, 2, 2, 2, 2, 2}, 0, 0));
  EXPECT_FALSE(has_settled({2, 2, 2, 2, 2}, 0, 1)) << "after four iterations";
  EXPECT_FALSE(has_settled({}, 0, 1));
}

TEST(Minimise, RefusesAStartWithoutAFiniteEnergy) {
  for (double start : {std::nan(""), std::numeric_limits<double>::infinity()}) {
    Function<double> objective(1, [start](const std::vector<double>&, std::vector<double>& gradient) {
      gradient[0] = 0;
      return start;
    });
    std::vector<double> x = {0.0};
    EXPECT_THROW(minimise<double>(objective, {}, x, go_on), NumericalFailure);
  }
}

TEST(Minimise, RefusesAStartWithoutAFiniteGradient) {
  Function<double> objective(1, [](const std::vector<double>&, std::vector<double>& gradient) {
    gradient[0] = std::nan("");
    return 1.0;
  });
  std::vector<double> x = {0.0};
  EXPECT_THROW(minimise<double>(objective, {}, x, go_on), NumericalFailure);
}

// sqrt(g . P g) of the least subgradient, by hand: at (0, 3) with 1/2 (x_0 - 5)^2 + 2 (x_1 - 1)^2 and weights 2 and 1
// the gradient is (-5, 8), the least subgradient (-3, 9).
TEST(Minimise, ReportsTheOptimalityResidual) {
  auto objective = separable<double>({1, 4}, {5, 1});
  objective.groups = {{0, 1, 1, 2.0, 1, {}}, {1, 2, 1, 1.0, 1, {}}};
  std::vector<double> x = {0, 3};
  Witness witness;
  MinimiseOptions options = to_the_end();
  options.optimality_tolerance = 1e-7;
  const MinimiseSummary summary = minimise<double>(objective, options, x, std::ref(witness));
  EXPECT_NEAR(summary.first_optimality, std::hypot(3, 9), 1e-12);
  EXPECT_EQ(summary.termination, MinimiseTermination::Converged);
  EXPECT_LE(summary.optimality, 1e-7);
  EXPECT_EQ(witness.steps.back().optimality, summary.optimality);
  EXPECT_NEAR(x[0], 3, 1e-5);
  EXPECT_NEAR(x[1], 0.75, 1e-5);
  // A later call measures against the same reference.
  options.optimality_reference = summary.first_optimality;
  const MinimiseSummary again = minimise<double>(objective, options, x, go_on);
  EXPECT_EQ(again.iterations, 0);
  EXPECT_EQ(again.termination, MinimiseTermination::Converged);
}

// Weights of single groups: 0 is free, infinity stays at 0, others are soft thresholds of their own.
TEST(Minimise, WeighsEveryGroupByItsOwnFactor) {
  auto objective = separable<double>({1, 1, 1, 1}, {3, 3, 3, 3});
  const float never = std::numeric_limits<float>::infinity();
  objective.groups = {{0, 4, 1, 0.5, 1, {0.0f, 1.0f, 2.0f, never}}};
  std::vector<double> x(4, 0.0);
  Witness witness;
  const MinimiseSummary summary = minimise<double>(objective, to_the_end(), x, std::ref(witness));
  EXPECT_NEAR(x[0], 3, 1e-7);
  EXPECT_NEAR(x[1], 2.5, 1e-7);
  EXPECT_NEAR(x[2], 2, 1e-7);
  EXPECT_EQ(x[3], 0);
  EXPECT_NEAR(summary.energy_after, 0.125 + 1.25 + 0.5 + 2 + 4.5, 1e-7);
}

// With the exact inverse Hessian as preconditioner the first direction is Newton's.
TEST(Minimise, WalksInTheMetricOfThePreconditioner) {
  std::vector<double> stiffness, centre;
  for (int i = 0; i < 30; ++i) {
    stiffness.push_back(std::pow(10.0, i / 5.0));
    centre.push_back(1 + 0.1 * i);
  }
  auto raw = separable<double>(stiffness, centre), preconditioned = separable<double>(stiffness, centre);
  for (std::size_t i = 0; i < stiffness.size(); ++i) preconditioned.preconditioner[i] = 1 / stiffness[i];
  // On ranges it is a number, wherever they lie and in whatever order they are named.
  for (std::size_t at : {20, 7, 8})
    preconditioned.groups.push_back({at, at + 1, 1, 0, preconditioned.preconditioner[at], {}});
  raw.step = 1e-6;
  std::vector<double> x(30, 0.0), y(30, 0.0);
  EXPECT_LE(minimise<double>(preconditioned, to_the_end(), x, go_on).iterations, 2);
  for (std::size_t i = 0; i < 30; ++i) EXPECT_NEAR(x[i], centre[i], 1e-9);
  EXPECT_GT(minimise<double>(raw, to_the_end(), y, go_on).iterations, 10);
}

}  // namespace
}  // namespace saltus
