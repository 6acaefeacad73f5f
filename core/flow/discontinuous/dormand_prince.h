#pragma once

#include <Eigen/Core>

#include <array>

namespace saltus {

/// One step of the Runge-Kutta pair of Dormand and Prince (1980), order 5 with an error estimate of order 4, and its
/// continuous extension of order 4 (Hairer, Norsett and Wanner, Solving ODEs I, section II.6).
template <int N>
class DormandPrinceStep {
 public:
  using State = Eigen::Matrix<double, N, 1>;

  DormandPrinceStep() = default;

  /// y' = derivative(t, y) from y at t over h.
  template <class Derivative>
  DormandPrinceStep(double t, const State& y, double h, Derivative&& derivative) {
    const State k1 = derivative(t, y);
    const State k2 = derivative(t + h / 5, y + h / 5 * k1);
    const State k3 = derivative(t + h * 3 / 10, y + h * (3.0 / 40 * k1 + 9.0 / 40 * k2));
    const State k4 = derivative(t + h * 4 / 5, y + h * (44.0 / 45 * k1 - 56.0 / 15 * k2 + 32.0 / 9 * k3));
    const State k5 = derivative(
        t + h * 8 / 9, y + h * (19372.0 / 6561 * k1 - 25360.0 / 2187 * k2 + 64448.0 / 6561 * k3 - 212.0 / 729 * k4));
    const State k6 = derivative(t + h, y + h * (9017.0 / 3168 * k1 - 355.0 / 33 * k2 + 46732.0 / 5247 * k3 +
                                                49.0 / 176 * k4 - 5103.0 / 18656 * k5));
    end_ = y + h * (35.0 / 384 * k1 + 500.0 / 1113 * k3 + 125.0 / 192 * k4 - 2187.0 / 6784 * k5 + 11.0 / 84 * k6);
    const State k7 = derivative(t + h, end_);
    error_ = h * (71.0 / 57600 * k1 - 71.0 / 16695 * k3 + 71.0 / 1920 * k4 - 17253.0 / 339200 * k5 + 22.0 / 525 * k6 -
                  1.0 / 40 * k7);
    start_ = y;
    dense_[0] = end_ - y;
    dense_[1] = h * k1 - dense_[0];
    dense_[2] = dense_[0] - h * k7 - dense_[1];
    dense_[3] =
        h * (-12715105075.0 / 11282082432 * k1 + 87487479700.0 / 32700410799 * k3 - 10690763975.0 / 1880347072 * k4 +
             701980252875.0 / 199316789632 * k5 - 1453857185.0 / 822651844 * k6 + 69997945.0 / 29380423 * k7);
  }

  const State& end() const { return end_; }
  const State& error() const { return error_; }

  /// y at t + share * h, share in [0, 1].
  State at(double share) const {
    return start_ + share * (dense_[0] + (1 - share) * (dense_[1] + share * (dense_[2] + (1 - share) * dense_[3])));
  }

 private:
  State start_, end_, error_;
  std::array<State, 4> dense_;
};

}  // namespace saltus
