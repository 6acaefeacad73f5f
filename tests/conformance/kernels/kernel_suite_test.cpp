// What every kernel profile owes its callers. A new kernel joins by one more entry in `kernels()`: its factory, and its
// derivatives in closed form, which are the oracle for taps that never sample a derivative.
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <functional>
#include <ostream>

#include "core/kernels/kernel_profile.h"
#include "tests/support/quadrature.h"

namespace saltus {
namespace {

using testing::integral;

struct Kernel {
  std::string name;
  std::function<std::unique_ptr<KernelProfile>(double sigma)> make;
  std::function<double(double r, double sigma)> slope;      ///< k0' away from 0
  std::function<double(double r, double sigma)> curvature;  ///< k0'' away from 0
  double dirac = 0;                                         ///< k0'' holds -dirac / sigma times a Dirac at 0
  double cut = 0;                                           ///< k0 just inside its support, as a share of k0(0)
};
void PrintTo(const Kernel& kernel, std::ostream* out) { *out << kernel.name; }

std::vector<Kernel> kernels() {
  const auto gaussian_slope = [](double r, double s) { return -2 * r / (s * s) * std::exp(-r * r / (s * s)); };
  const auto gaussian_curvature = [](double r, double s) {
    return (4 * r * r / (s * s) - 2) / (s * s) * std::exp(-r * r / (s * s));
  };
  const auto wendland_slope = [](double r, double s) {
    return std::abs(r) < s ? std::copysign(2 / s * (1 - std::abs(r) / s), -r) : 0.0;
  };
  const auto wendland_curvature = [](double r, double s) { return std::abs(r) < s ? 2 / (s * s) : 0.0; };
  return {{"gaussian", make_gaussian_profile, gaussian_slope, gaussian_curvature, 0, 1e-5},
          {"wendland", make_wendland_profile, wendland_slope, wendland_curvature, 4, 0}};
}

class KernelSuite : public ::testing::TestWithParam<Kernel> {
 protected:
  std::unique_ptr<KernelProfile> make(double sigma) const { return GetParam().make(sigma); }
  double slope(double r, double sigma) const { return GetParam().slope(r, sigma); }

  /// Integral of f against a window that is centred at `at` and reaches as far as `reach`.
  template <class Function, class Window>
  static double against(Function&& f, Window&& window, double at, double reach, double support) {
    return integral([&](double r) { return f(r) * window(r - at); }, at - reach, at + reach,
                    {at, 0, support, -support});
  }
};

TEST_P(KernelSuite, TellsItsNameAndWidth) {
  const auto profile = make(2.5);
  EXPECT_EQ(profile->name(), GetParam().name);
  EXPECT_EQ(profile->width(), 2.5);
}

TEST_P(KernelSuite, IsOneAtZeroEvenAndGoneBeyondItsSupport) {
  for (double sigma : {0.7, 3.0, 40.0}) {
    const auto profile = make(sigma);
    EXPECT_EQ(profile->value(0), 1);
    for (double r = 0.01 * sigma; r < 1.5 * profile->support(); r += 0.09 * sigma) {
      EXPECT_EQ(profile->value(r), profile->value(-r));
      EXPECT_LT(profile->value(r), profile->value(r - 0.01 * sigma) + 1e-15) << "not falling at " << r;
      EXPECT_EQ(profile->first_integral(r), -profile->first_integral(-r));
      EXPECT_EQ(profile->second_integral(r), profile->second_integral(-r));
    }
    EXPECT_GT(profile->value(0.999 * profile->support()), 0);
    EXPECT_LE(profile->value(profile->support()), GetParam().cut * (1 + 1e-12));
    EXPECT_EQ(profile->first_integral(0), 0);
  }
}

// Oracle: quadrature of value() and first_integral().
TEST_P(KernelSuite, HasIntegralsThatAgreeWithQuadrature) {
  const double sigma = 1.7;
  const auto profile = make(sigma);
  const double support = profile->support();
  for (double r : {0.1, 0.9, 1.6, 1.8, 4.0, 9.0}) {
    const double first = integral([&](double t) { return profile->value(t); }, 0, r, {support});
    const double second = integral([&](double t) { return profile->first_integral(t); }, 0, r, {support});
    EXPECT_NEAR(profile->first_integral(r), first, 1e-10 * sigma) << r;
    EXPECT_NEAR(profile->second_integral(r) - profile->second_integral(0), second, 1e-10 * sigma * sigma) << r;
  }
  EXPECT_NEAR(profile->mass(), integral([&](double t) { return profile->value(t); }, -support, support, {0}), 1e-9);
}

// Oracle: the integrals in the comment of cell_averaged_taps, by quadrature of the closed-form derivatives.
TEST_P(KernelSuite, HasTapsThatAreCellAverages) {
  const double sigma = 2.0;
  const auto profile = make(sigma);
  const double support = profile->support(), mass = profile->mass();
  for (double h : {0.3, 1.0, 1.9, 5.0}) {
    SCOPED_TRACE(h);
    const KernelTaps taps = cell_averaged_taps(*profile, h);
    const std::size_t count = 2 * static_cast<std::size_t>(taps.radius) + 1;
    ASSERT_EQ(taps.value.size(), count);
    ASSERT_EQ(taps.slope.size(), count);
    ASSERT_EQ(taps.curvature.size(), count);
    ASSERT_EQ(taps.slope_gram.size(), count);
    const auto hat = [h](double r) { return std::max(0.0, 1 - std::abs(r) / h) / h; };
    const auto box = [h](double) { return 1 / h; };
    const auto k0 = [&](double r) { return profile->value(r); };
    const auto k1 = [&](double r) { return slope(r, sigma); };
    const auto k2 = [&](double r) { return GetParam().curvature(r, sigma); };
    for (int t = -taps.radius; t <= taps.radius; ++t) {
      const std::size_t at = static_cast<std::size_t>(t + taps.radius);
      EXPECT_NEAR(taps.value[at], h / mass * against(k0, hat, t * h, h, support), 1e-9);
      EXPECT_NEAR(taps.slope[at], h * sigma / mass * against(k1, box, (t - 0.5) * h, h / 2, support), 1e-9);
      EXPECT_NEAR(taps.slope_gram[at], h * sigma / mass * against(k1, hat, (t - 0.5) * h, h, support), 1e-9);
      const double regular = against(k2, hat, t * h, h, support);
      EXPECT_NEAR(taps.curvature[at], -h * sigma * sigma / mass * (regular - GetParam().dirac / sigma * hat(t * h)),
                  1e-9)
          << "tap " << t;
    }
  }
}

TEST_P(KernelSuite, HasValueTapsThatSumToOne) {
  for (double sigma : {2.0, 9.0, 40.0}) {
    const KernelTaps taps = cell_averaged_taps(*make(sigma), 1.0);
    double value = 0, slope_sum = 0, curvature = 0;
    for (double tap : taps.value) value += tap;
    for (double tap : taps.slope) slope_sum += tap;
    for (double tap : taps.curvature) curvature += tap;
    EXPECT_NEAR(value, 1, 1e-12 + GetParam().cut) << sigma;
    EXPECT_NEAR(slope_sum, 0, 1e-12 + GetParam().cut) << sigma;  // a constant momentum of order 1 makes no velocity
    EXPECT_NEAR(curvature, 0, 1e-10 + 10 * GetParam().cut * sigma) << sigma;
  }
}

// Even and odd, to the last bit or nearly: transposes are taken by reading a row backwards.
TEST_P(KernelSuite, HasEvenAndOddRowsOfTaps) {
  for (double h : {0.3, 1.0, 5.0}) {
    const KernelTaps taps = cell_averaged_taps(*make(2.0), h);
    const auto at = [&](const std::vector<double>& row, int t) {
      return std::abs(t) <= taps.radius ? row[static_cast<std::size_t>(t + taps.radius)] : 0.0;
    };
    for (int t = -taps.radius; t <= taps.radius; ++t) {
      EXPECT_NEAR(at(taps.value, t), at(taps.value, -t), 1e-14) << t;
      EXPECT_NEAR(at(taps.curvature, t), at(taps.curvature, -t), 1e-14) << t;
      if (t == -taps.radius) continue;  // its mirror is beyond the row
      EXPECT_NEAR(at(taps.slope, t), -at(taps.slope, 1 - t), 1e-14) << t;
      EXPECT_NEAR(at(taps.slope_gram, t), -at(taps.slope_gram, 1 - t), 1e-14) << t;
    }
  }
}

// A derivative is the difference of the row below it: slope of k0 itself, curvature of slope, face by face.
TEST_P(KernelSuite, HasDerivativesThatAreDifferences) {
  const double sigma = 2.0;
  const auto profile = make(sigma);
  for (double h : {0.3, 1.0, 1.9}) {
    const KernelTaps taps = cell_averaged_taps(*profile, h);
    for (int t = -taps.radius; t < taps.radius; ++t) {
      const std::size_t at = static_cast<std::size_t>(t + taps.radius);
      EXPECT_NEAR(taps.slope[at], sigma / profile->mass() * (profile->value(t * h) - profile->value((t - 1) * h)),
                  1e-14);
      EXPECT_NEAR(taps.curvature[at], -sigma / h * (taps.slope[at + 1] - taps.slope[at]), 1e-12) << t;
    }
  }
}

// Nothing reaches further than the support and one cell.
TEST_P(KernelSuite, HasTapsOfCompactSupport) {
  for (double sigma : {1.7, 6.0, 40.0}) {
    const auto profile = make(sigma);
    const KernelTaps taps = cell_averaged_taps(*profile, 1.0);
    EXPECT_LE(taps.radius, std::ceil(profile->support()) + 1);
    for (int t = -taps.radius; t <= taps.radius; ++t) {
      const std::size_t at = static_cast<std::size_t>(t + taps.radius);
      if (std::abs(t) - 1 >= profile->support()) {
        EXPECT_LE(std::abs(taps.value[at]), GetParam().cut) << t;
        EXPECT_LE(std::abs(taps.curvature[at]), 4 * GetParam().cut * sigma * sigma) << t;
      }
      if (std::abs(t - 0.5) - 0.5 >= profile->support()) {
        EXPECT_LE(std::abs(taps.slope[at]), GetParam().cut) << t;
      }
      if (std::abs(t - 0.5) - 1 >= profile->support()) {
        EXPECT_LE(std::abs(taps.slope_gram[at]), 4 * GetParam().cut * sigma) << t;
      }
    }
  }
}

// A kernel of a metric is positive definite, and so is what its second derivative makes of order 1. A kernel that is
// cut may miss that by what was cut.
TEST_P(KernelSuite, HasPositiveSemiDefiniteGramMatrices) {
  for (double h : {0.25, 1.0, 4.0}) {
    const KernelTaps taps = cell_averaged_taps(*make(3.0), h);
    for (const auto* row : {&taps.value, &taps.curvature}) {
      constexpr int n = 90;
      Eigen::MatrixXd gram(n, n);
      for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j)
          gram(i, j) = std::abs(i - j) <= taps.radius ? (*row)[static_cast<std::size_t>(i - j + taps.radius)] : 0.0;
      ASSERT_LT((gram - gram.transpose()).cwiseAbs().maxCoeff(), 1e-11);
      const Eigen::VectorXd values =
          Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(gram, Eigen::EigenvaluesOnly).eigenvalues();
      EXPECT_GT(values.minCoeff(), -(1e-11 + GetParam().cut) * values.maxCoeff()) << "spacing " << h;
    }
  }
}

/// A density of momentum on the line, and what it makes in the limit of no spacing.
struct Density {
  double at(double x) const { return std::exp(-x * x / 2.25); }
  double slope(double x) const { return -2 * x / 2.25 * at(x); }
};

// Oracle: quadrature of the continuous velocity and energy of one fixed density. Both are second order in the spacing.
TEST_P(KernelSuite, MakesVelocitiesAndEnergiesThatConverge) {
  const double sigma = 3.0, reach = 9.0;
  const auto profile = make(sigma);
  const double mass = profile->mass(), support = profile->support();
  const Density m;
  const std::vector<double> places = {0.0, 0.5, 1.5, -2.0};
  const auto convolve = [&](double x, auto&& kernel, auto&& density) {
    return integral([&](double y) { return kernel(x - y) * density(y); }, -reach, reach, {x, x - support, x + support});
  };
  const auto k0 = [&](double r) { return profile->value(r); };
  const auto k1 = [&](double r) { return slope(r, sigma); };
  const auto value = [&](double y) { return m.at(y); };
  const auto gradient = [&](double y) { return m.slope(y); };
  // By parts: <m, -k0'' * m> = <m', k0 * m'>, so that no Dirac is left.
  const double energy0 =
      integral([&](double x) { return m.at(x) * convolve(x, k0, value); }, -reach, reach) / (2 * mass);
  const double energy1 = sigma * sigma *
                         integral([&](double x) { return m.slope(x) * convolve(x, k0, gradient); }, -reach, reach) /
                         (2 * mass);

  std::vector<double> error_energy0, error_energy1, error_velocity0, error_velocity1;
  for (double h : {0.5, 0.25, 0.125}) {
    const KernelTaps taps = cell_averaged_taps(*profile, h);
    const int half = static_cast<int>(std::lround(reach / h));
    const auto tap = [&](const std::vector<double>& row, int t) {
      return std::abs(t) <= taps.radius ? row[static_cast<std::size_t>(t + taps.radius)] : 0.0;
    };
    double e0 = 0, e1 = 0;
    for (int i = -half; i <= half; ++i)
      for (int j = -half; j <= half; ++j) {
        e0 += 0.5 * h * m.at(i * h) * tap(taps.value, i - j) * m.at(j * h);
        e1 += 0.5 * h * m.at((i + 0.5) * h) * tap(taps.curvature, i - j) * m.at((j + 0.5) * h);
      }
    error_energy0.push_back(std::abs(e0 - energy0) / energy0);
    error_energy1.push_back(std::abs(e1 - energy1) / energy1);
    double worst0 = 0, worst1 = 0;
    for (double x : places) {
      const int i = static_cast<int>(std::lround(x / h));
      double v0 = 0, v1 = 0;
      for (int j = -half; j <= half; ++j) {
        v0 += tap(taps.value, i - j) * m.at(j * h);
        v1 += tap(taps.slope, i - j) * m.at((j + 0.5) * h);
      }
      worst0 = std::max(worst0, std::abs(v0 - convolve(x, k0, value) / mass));
      worst1 = std::max(worst1, std::abs(v1 - sigma * convolve(x, k1, value) / mass));
    }
    error_velocity0.push_back(worst0);
    error_velocity1.push_back(worst1);
  }
  for (const auto* errors : {&error_energy0, &error_energy1, &error_velocity0, &error_velocity1}) {
    EXPECT_LT((*errors)[0], 0.06);
    for (int k : {0, 1})
      EXPECT_GT((*errors)[k] / (*errors)[k + 1], 3.6) << (*errors)[k] << " then " << (*errors)[k + 1];
  }
}

INSTANTIATE_TEST_SUITE_P(Kernels, KernelSuite, ::testing::ValuesIn(kernels()),
                         [](const auto& info) { return info.param.name; });

// The limit that the whole method rests on: the value of -k0'' * L at 0 grows as 4 / (sigma h).
TEST(WendlandKernel, HasTheDiracOfItsSecondDerivativeInTheCentralTap) {
  const double sigma = 5;
  const auto profile = make_wendland_profile(sigma);
  for (double h : {1.0, 0.1, 0.01}) {
    const KernelTaps taps = cell_averaged_taps(*profile, h);
    const double centre = taps.curvature[static_cast<std::size_t>(taps.radius)];
    // Regular part: -2 / sigma^2, all of the hat inside the support.
    EXPECT_NEAR(centre, h * sigma * sigma / profile->mass() * (4 / (sigma * h) - 2 / (sigma * sigma)), 1e-9);
  }
}

}  // namespace
}  // namespace saltus
