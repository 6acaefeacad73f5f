// When a run ends, and what joins its working set before. Oracle: functions whose minimum is known.
#include <gtest/gtest.h>

#include <cmath>

#include "core/optimisation/lbfgs.h"

namespace saltus {
namespace {

const auto go_on = [](const MinimiseStep&) { return true; };

/// 1/2 (x - 1)^2 + 1/2 (y - x)^2, where y is left at 0 until a look shows that its gradient is above 0.3.
class Chain final : public Objective<double> {
 public:
  std::size_t size() const override { return has_second_ ? 2 : 1; }
  bool has_more() const override { return !has_second_; }
  void look_everywhere(bool everywhere) override { looks_ = everywhere; }
  Evaluation evaluate(const std::vector<double>& at, std::vector<double>& gradient,
                      std::vector<double>& preconditioned) override {
    const double x = at[0], y = has_second_ ? at[1] : 0;
    gradient[0] = (x - 1) + (x - y);
    if (has_second_) gradient[1] = y - x;
    seen_ = looks_ ? y - x : 0;
    if (looks_ && !has_second_) ++looks_taken;
    looked.push_back(looks_);
    preconditioned = gradient;
    ++evaluations;
    return {0.5 * (x - 1) * (x - 1) + 0.5 * (y - x) * (y - x), true};
  }
  double first_step(const std::vector<double>&) override { return 1e-3; }
  Revision revise(MinimiserState<double>& state) override {
    if (has_second_ || std::abs(seen_) <= 0.3) return {};
    has_second_ = true;
    state.x.push_back(0);
    state.gradient.push_back(seen_);
    state.preconditioned.push_back(seen_);
    for (CurvaturePair<double>& pair : state.pairs)
      for (std::vector<double>* values : {&pair.s, &pair.y, &pair.y_preconditioned}) values->push_back(0);
    return {true, 0.5};
  }

  int looks_taken = 0, evaluations = 0;
  std::vector<bool> looked;  ///< by evaluation

 private:
  bool has_second_ = false, looks_ = true;
  double seen_ = 0;
};

// Oracle: the minimum of the chain. With x alone the energy is least at 1/2, where nothing is left to do without a
// look.
TEST(Minimise, EndsOnlyWhereItHasLookedOutsideTheWorkingSet) {
  Chain chain;
  std::vector<double> x = {0};
  MinimiseOptions how;
  how.optimality_tolerance = 1e-9;
  how.tolerance = 0;
  const MinimiseSummary summary = minimise<double>(chain, how, x, [](const MinimiseStep&) { return true; });
  EXPECT_EQ(summary.termination, MinimiseTermination::Converged);
  ASSERT_EQ(x.size(), 2u);
  EXPECT_NEAR(x[0], 1, 1e-7);
  EXPECT_NEAR(x[1], 1, 1e-7);
  EXPECT_LT(chain.looks_taken, chain.evaluations / 2);
  EXPECT_TRUE(chain.looked[0]);
  EXPECT_FALSE(chain.looked[1]) << "the first iteration is none of those that look";
}

/// x^4, which is approached without end, with something outside that never wants to take part.
class Flat final : public Objective<double> {
 public:
  std::size_t size() const override { return 1; }
  bool has_more() const override { return true; }
  void look_everywhere(bool everywhere) override { looks = everywhere; }
  Evaluation evaluate(const std::vector<double>& x, std::vector<double>& gradient,
                      std::vector<double>& preconditioned) override {
    preconditioned = gradient = {4 * std::pow(x[0], 3)};
    return {std::pow(x[0], 4), true};
  }
  double first_step(const std::vector<double>&) override { return 1e-2; }

  bool looks = true;  ///< whether the last evaluation looked everywhere
};

/// The sum of (x_k - 1)^4 over three unknowns, of which every second look finds one more: looks that are due do so
/// late.
class OneByOne final : public Objective<double> {
 public:
  std::size_t size() const override { return present_; }
  bool has_more() const override { return present_ < 3; }
  void look_everywhere(bool everywhere) override { looks_ = everywhere; }
  Evaluation evaluate(const std::vector<double>& x, std::vector<double>& gradient,
                      std::vector<double>& preconditioned) override {
    double energy = 3 - static_cast<double>(x.size());
    for (std::size_t k = 0; k < x.size(); ++k) {
      energy += std::pow(x[k] - 1, 4);
      gradient[k] = 4 * std::pow(x[k] - 1, 3);
    }
    preconditioned = gradient;
    return {energy, true};
  }
  double first_step(const std::vector<double>&) override { return 1e-2; }
  Revision revise(MinimiserState<double>& state) override {
    // Not at the start, where nothing has settled yet.
    if (!looks_ || !has_more() || state.iterations() == 0 || ++looked_ < 2) return {};
    looked_ = 0;
    ++present_;
    joined_at.push_back(state.iterations());
    state.x.push_back(0);
    state.gradient.push_back(-4);
    state.preconditioned.push_back(-4);
    for (CurvaturePair<double>& pair : state.pairs)
      for (std::vector<double>* values : {&pair.s, &pair.y, &pair.y_preconditioned}) values->push_back(0);
    return {true, 0.5};
  }

  std::vector<int> joined_at;

 private:
  std::size_t present_ = 1;
  int looked_ = 0;
  bool looks_ = true;
};

// What joined was worth something: so the run may settle another time, and let another one in.
TEST(Minimise, LetsMoreInAfterWhatJoinedWasWorthIt) {
  OneByOne objective;
  MinimiserState<double> state(std::vector<double>{0});
  MinimiseOptions how;
  how.tolerance = 0.05;
  const MinimiseSummary summary = minimise<double>(objective, how, state, go_on);
  EXPECT_EQ(summary.termination, MinimiseTermination::Settled);
  ASSERT_EQ(state.x.size(), 3u);
  EXPECT_LT(objective.joined_at[0], 15) << "a look that was due let it in, not the settling";
  EXPECT_LT(objective.joined_at[1] - objective.joined_at[0], 15);
  for (double x : state.x) EXPECT_NEAR(x, 1, 0.3);
}

TEST(Minimise, SettlesOnlyWhereItHasLookedOutsideTheWorkingSet) {
  for (double tolerance : {0.3, 0.1, 3e-2, 1e-2, 1e-3, 1e-4}) {
    SCOPED_TRACE(tolerance);
    Flat flat;
    std::vector<double> x = {1};
    MinimiseOptions how;
    how.tolerance = tolerance;
    const MinimiseSummary summary = minimise<double>(flat, how, x, go_on);
    EXPECT_EQ(summary.termination, MinimiseTermination::Settled);
    EXPECT_TRUE(flat.looks);
  }
}

/// (x - 1)^2 / 2 and, outside the working set at first, ever more unknowns that each want to take part and are worth
/// next to nothing: one joins at every look.
class Trickle final : public Objective<double> {
 public:
  explicit Trickle(double share) : share_(share) {}  ///< of a range, that joins each time
  static constexpr double kWorth = 1e-6;
  std::size_t size() const override { return size_; }
  bool has_more() const override { return true; }
  void look_everywhere(bool everywhere) override { looks_ = everywhere; }
  Evaluation evaluate(const std::vector<double>& x, std::vector<double>& gradient,
                      std::vector<double>& preconditioned) override {
    gradient.assign(size_, 0);
    gradient[0] = 4 * std::pow(x[0] - 1, 3);
    double energy = std::pow(x[0] - 1, 4);
    for (std::size_t i = 1; i < size_; ++i) {
      gradient[i] = kWorth * (x[i] - 1);
      energy += 0.5 * kWorth * (x[i] - 1) * (x[i] - 1) - 0.5 * kWorth;
    }
    preconditioned = gradient;
    return {energy, true};
  }
  double first_step(const std::vector<double>&) override { return 1e-2; }
  Revision revise(MinimiserState<double>& state) override {
    if (!looks_) return {};
    ++size_;
    state.x.push_back(0);
    for (std::vector<double>* values : {&state.gradient, &state.preconditioned}) values->push_back(-kWorth);
    for (CurvaturePair<double>& pair : state.pairs)
      for (std::vector<double>* values : {&pair.s, &pair.y, &pair.y_preconditioned}) values->push_back(0);
    return {true, share_};
  }

 private:
  double share_;
  std::size_t size_ = 1;
  bool looks_ = true;
};

/// A run in which that share joins at each look.
MinimiseSummary with_a_trickle_of(double share) {
  Trickle trickle(share);
  std::vector<double> x = {0};
  MinimiseOptions how;
  how.tolerance = 1e-2;
  how.max_iterations = 500;
  const MinimiseSummary summary = minimise<double>(trickle, how, x, go_on);
  EXPECT_EQ(summary.termination, MinimiseTermination::Settled);
  return summary;
}

TEST(Minimise, SettlesThoughMoreThatIsWorthNextToNothingWantsToJoin) {
  EXPECT_LT(with_a_trickle_of(0.5).iterations, 60);
}

TEST(Minimise, SettlesAtOnceWhereHardlyAnythingWantsToJoin) {
  const int much = with_a_trickle_of(0.06).iterations;
  EXPECT_EQ(much, with_a_trickle_of(0.5).iterations);
  EXPECT_LE(with_a_trickle_of(0.04).iterations, much - 5);
}

// Oracle: the decrease that a level had before makes the same run end earlier, and where the share says.
TEST(Minimise, CountsTheDecreaseOfAnEarlierRunToTheWhole) {
  MinimiseOptions how;
  how.tolerance = 1e-3;
  const auto energies = [&](double before) {
    Flat flat;
    std::vector<double> x = {1}, found = {1};
    how.decrease_before = before;
    minimise<double>(flat, how, x, [&](const MinimiseStep& step) {
      found.push_back(step.energy);
      return true;
    });
    return found;
  };
  for (double before : {0.0, 3.0, 30.0}) {
    SCOPED_TRACE(before);
    const std::vector<double> e = energies(before);
    const std::size_t n = e.size() - 1;
    ASSERT_GT(n, 6u);
    EXPECT_LE(e[n - 5] - e[n], 1e-3 * (before + e[0] - e[n]));
    EXPECT_GT(e[n - 6] - e[n - 1], 1e-3 * (before + e[0] - e[n - 1]));
  }
  EXPECT_LT(energies(30).size(), energies(0).size());
}

/// 1/2 |x|^2 of two unknowns, of which noise makes a gradient of length 1, and a group that it pulls at as well.
class WithNoise final : public Objective<double> {
 public:
  WithNoise() { ranges_[0] = {2, 3, 1, 0.1, 1, {}}; }
  std::size_t size() const override { return 3; }
  const std::vector<GroupSparsity>& sparsity() const override { return ranges_; }
  Evaluation evaluate(const std::vector<double>& x, std::vector<double>& gradient,
                      std::vector<double>& preconditioned) override {
    gradient = {x[0], 4 * x[1], x[2]};
    preconditioned = {x[0], 4 * x[1]};
    return {0.5 * (x[0] * x[0] + 4 * x[1] * x[1] + x[2] * x[2]), true};
  }
  bool noise_gradient(const std::vector<double>& x, std::vector<double>& gradient,
                      std::vector<double>& preconditioned) override {
    ++asked;
    EXPECT_EQ(x, start);
    gradient = {0.6, 0.8, 5};
    preconditioned = {0.6, 0.8};
    return is_known;
  }
  double first_step(const std::vector<double>&) override { return 1e-2; }

  std::vector<double> start;
  bool is_known = true;
  int asked = 0;

 private:
  std::vector<GroupSparsity> ranges_ = std::vector<GroupSparsity>(1);
};

// Oracle: the residual is |(x, 4 y)| while the group is at zero, and that of noise is 1, whatever it does to the group.
TEST(Minimise, EndsWhereMostlyNoisePulls) {
  MinimiseOptions how;
  how.optimality_tolerance = 1e-9;
  how.tolerance = 0;
  for (double share : {0.0, 0.01, 0.25}) {
    SCOPED_TRACE(share);
    how.noise_tolerance = share;
    WithNoise objective;
    std::vector<double> x = objective.start = {3, 2, 0};
    std::vector<double> residuals = {std::hypot(3, 8)};
    const MinimiseSummary summary = minimise<double>(objective, how, x, [&](const MinimiseStep& step) {
      residuals.push_back(step.optimality * residuals.front());
      return true;
    });
    EXPECT_EQ(objective.asked, share > 0);
    if (share == 0) {
      EXPECT_EQ(summary.termination, MinimiseTermination::Converged);
      continue;
    }
    EXPECT_EQ(summary.termination, MinimiseTermination::NoiseFloor);
    EXPECT_NEAR(residuals.back(), std::hypot(x[0], 4 * x[1]), 1e-12);
    EXPECT_LE(residuals.back(), std::sqrt(share));
    for (std::size_t k = 0; k + 1 < residuals.size(); ++k) EXPECT_GT(residuals[k], std::sqrt(share)) << k;
  }
}

TEST(Minimise, DoesNothingWhereItBeginsWithNoise) {
  MinimiseOptions how;
  how.optimality_tolerance = 1e-9;
  how.noise_tolerance = 0.25;
  WithNoise objective;
  std::vector<double> x = objective.start = {0.1, 0.1, 0};
  const MinimiseSummary summary = minimise<double>(objective, how, x, go_on);
  EXPECT_EQ(summary.termination, MinimiseTermination::NoiseFloor);
  EXPECT_EQ(summary.iterations, 0);
  EXPECT_EQ(x, objective.start);

  WithNoise unknown;
  unknown.is_known = false;
  x = unknown.start = {0.1, 0.1, 0};
  EXPECT_EQ(minimise<double>(unknown, how, x, go_on).termination, MinimiseTermination::Converged);
}

}  // namespace
}  // namespace saltus
