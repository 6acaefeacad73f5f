// One scene of fixed densities at spacing h, h/2 and h/4: energy and velocity converge to what quadrature or a closed
// form says, for every kernel and sum of kernels. Densities are products, so that integrals are products too.
#include <gtest/gtest.h>

#include <cmath>

#include "core/momenta/momentum_scale.h"
#include "tests/conformance/kernels/kernel_sums.h"
#include "tests/support/quadrature.h"

namespace saltus {
namespace {

using testing::integral;
using testing::NamedKernel;

constexpr double kExtent = 24, kMiddle = 12, kSigma = 4, kZerothWeight = 1.3, kFirstWeight = 0.7;

/// The density along each axis, nothing near the border.
double bump(double s) { return std::exp(-s * s / 4); }
double bump_slope(double s) { return -s / 2 * bump(s); }

/// Integrals with one component's k0 / mass.
class Line {
 public:
  explicit Line(const KernelProfile& profile) : profile_(profile) {}
  template <class Left, class Right>
  double pair(Left&& left, Right&& right) const {
    return integral([&](double x) { return left(x) * convolved(right, x); }, -kMiddle, kMiddle);
  }
  template <class Density>
  double convolved(Density&& density, double x) const {
    const double reach = profile_.support();
    return integral([&](double y) { return profile_.value(x - y) * density(y); }, -kMiddle, kMiddle,
                    {x, x - reach, x + reach}) /
           profile_.mass();
  }

 private:
  const KernelProfile& profile_;
};

/// The scene at one spacing: which order (-1 zeroth, else axis) carries the density along (1, -2).
struct Scene {
  Lattice<2> lattice;
  MomentumScale<2, double> scale;
  std::vector<double> zeroth, first;

  Scene(const KernelSum& kernel, double h)
      : lattice{{static_cast<int>(std::lround(kExtent / h)) + 1, static_cast<int>(std::lround(kExtent / h)) + 1},
                {h, h},
                {}},
        scale({kernel, lattice, Orders::ZerothAndFirst, kZerothWeight, kFirstWeight}),
        zeroth(scale.field_size(), 0.0),
        first(2 * scale.field_size(), 0.0) {}

  std::size_t site(int x, int y) const { return static_cast<std::size_t>(y * lattice.size[0] + x); }
  template <class Density>
  void fill(int order, Density&& density) {
    const double h = lattice.spacing[0];
    for (int y = 0; y < lattice.size[1]; ++y)
      for (int x = 0; x < lattice.size[0]; ++x) {
        const double value =
            density((x + (order == 0 ? 0.5 : 0)) * h - kMiddle, (y + (order == 1 ? 0.5 : 0)) * h - kMiddle);
        double* to = order < 0 ? zeroth.data() : first.data() + static_cast<std::size_t>(order) * scale.field_size();
        to[2 * site(x, y)] = value;
        to[2 * site(x, y) + 1] = -2 * value;
      }
  }
  double penalty() {
    std::vector<double> g0(zeroth.size()), g1(first.size());
    return scale.penalty(zeroth.data(), first.data(), g0.data(), g1.data());
  }
  /// First component at samples.
  std::vector<double> velocity(const std::vector<std::array<double, 2>>& places) {
    std::vector<double> v(zeroth.size()), at;
    scale.synthesise(zeroth.data(), first.data(), v.data());
    const double h = lattice.spacing[0];
    for (const auto& [x, y] : places)
      at.push_back(v[2 * site(static_cast<int>(std::lround((x + kMiddle) / h)),
                              static_cast<int>(std::lround((y + kMiddle) / h)))]);
    return at;
  }
};

class RefinementSuite : public ::testing::TestWithParam<NamedKernel> {
 protected:
  KernelSum kernel() const { return GetParam().make(kSigma); }

  /// Errors at h, h/2, h/4 fall fourfold, down to what the kernel's cut leaves.
  void expect_second_order(const std::vector<double>& errors, const char* what) const {
    EXPECT_LT(errors[0], 0.1) << what;
    for (int k : {0, 1})
      EXPECT_LT(errors[k + 1], errors[k] / 3.5 + 10 * GetParam().cut + 1e-11)
          << what << ": " << errors[k] << " then " << errors[k + 1];
  }
};

TEST_P(RefinementSuite, ConvergesWithSecondOrderForSmoothDensities) {
  const KernelSum k = kernel();
  const std::vector<std::array<double, 2>> places = {{0, 0}, {1, -2}, {-3, 1}, {2, 5}};
  for (int order : {-1, 0, 1}) {
    double energy = 0;
    std::vector<double> velocity(places.size(), 0.0);
    for (const KernelComponent& component : k.components()) {
      const Line line(*component.profile);
      if (order < 0) {
        const double one = line.pair(bump, bump);
        energy += component.weight * one * one;
        for (std::size_t p = 0; p < places.size(); ++p)
          velocity[p] += kZerothWeight * component.weight * line.convolved(bump, places[p][0]) *
                         line.convolved(bump, places[p][1]);
      } else {
        energy += component.weight * k.width() * k.width() * line.pair(bump_slope, bump_slope) * line.pair(bump, bump);
        for (std::size_t p = 0; p < places.size(); ++p)
          velocity[p] += kFirstWeight * k.width() * component.weight *
                         line.convolved(bump_slope, places[p][static_cast<std::size_t>(order)]) *
                         line.convolved(bump, places[p][static_cast<std::size_t>(1 - order)]);
      }
    }
    energy *= 0.5 * (1 + 4) * (order < 0 ? kZerothWeight : kFirstWeight);
    double largest = 0;
    for (double v : velocity) largest = std::max(largest, std::abs(v));

    std::vector<double> energy_errors, velocity_errors;
    for (double h : {1.0, 0.5, 0.25}) {
      Scene scene(k, h);
      scene.fill(order, [](double x, double y) { return bump(x) * bump(y); });
      energy_errors.push_back(std::abs(scene.penalty() - energy) / energy);
      const std::vector<double> found = scene.velocity(places);
      double worst = 0;
      for (std::size_t p = 0; p < places.size(); ++p) worst = std::max(worst, std::abs(found[p] - velocity[p]));
      velocity_errors.push_back(worst / largest);
    }
    SCOPED_TRACE(order);
    expect_second_order(energy_errors, "energy");
    expect_second_order(velocity_errors, "velocity");
  }
}

/// The same for the kernels whose first order jumps.
class SheetSuite : public RefinementSuite {
 public:
  static std::vector<NamedKernel> kernels() {
    std::vector<NamedKernel> some = testing::named_kernels();
    std::erase_if(some, [](const NamedKernel& kernel) { return !kernel.has_jump; });
    return some;
  }
};

/// A sheet of first-order momentum of fixed strength at a face along x, 1 / h in the one layer of cells that holds it.
void fill_sheet(Scene& scene, double strength_at(double)) {
  const double h = scene.lattice.spacing[0];
  scene.fill(0, [&](double x, double y) { return std::abs(x - h / 2) < 0.1 * h ? strength_at(y) / h : 0.0; });
}

// Oracle: the jump of sigma a_1 k0' / mass across 0 is -4 a_1 / mass sigma / sigma_q, times what the kernel makes of
// the strength along the sheet. From both sides, linearly extrapolated to the face.
TEST_P(SheetSuite, MakesASheetJumpByTheSameAmountAtEverySpacing) {
  const KernelSum k = kernel();
  double jump = 0;
  for (const KernelComponent& component : k.components())
    jump -= component.weight * 4 * kFirstWeight * k.width() / component.profile->width() / component.profile->mass() *
            Line(*component.profile).convolved(bump, 1.0);
  std::vector<double> errors;
  for (double h : {1.0, 0.5, 0.25}) {
    Scene scene(k, h);
    fill_sheet(scene, bump);
    // The face lies between the samples at 0 and h.
    const std::vector<double> v = scene.velocity({{-h, 1}, {0, 1}, {h, 1}, {2 * h, 1}});
    const double below = v[1] + (v[1] - v[0]) / 2, above = v[2] - (v[3] - v[2]) / 2;
    errors.push_back(std::abs(above - below - jump) / std::abs(jump));
    // Nothing of the jump is lost into a layer: next to the sheet the velocity moves little between samples.
    EXPECT_LT(std::abs(v[1] - v[0]), 0.4 * h * std::abs(jump));
  }
  expect_second_order(errors, "jump");
}

// Oracle: for a sheet, sigma^2 / mass (4 / (sigma h) - 2 / sigma^2) across, which has no limit (the Dirac of k0''); for
// a slab of fixed thickness w < sigma, sigma^2 / mass (4 w / sigma - 2 w^2 / sigma^2), which cells of any spacing hold
// exactly. Along the sheet the energy of the strength, second order.
TEST_P(SheetSuite, HoldsTheDiracOfTheSecondDerivativeInSheetsAndSlabs) {
  const KernelSum k = kernel();
  constexpr double kThickness = 2;
  std::vector<double> sheet_errors, slab_errors;
  for (double h : {1.0, 0.5, 0.25}) {
    double sheet = 0, slab = 0;
    for (const KernelComponent& component : k.components()) {
      const double s = component.profile->width();
      ASSERT_LT(kThickness, s);
      const double along = Line(*component.profile).pair(bump, bump);
      const double factor =
          0.5 * 5 * kFirstWeight * component.weight * k.width() * k.width() / component.profile->mass() * along;
      sheet += factor * (4 / (s * h) - 2 / (s * s));
      slab += factor * (4 * kThickness / s - 2 * kThickness * kThickness / (s * s));
    }
    Scene one(k, h), two(k, h);
    fill_sheet(one, bump);
    two.fill(0, [&](double x, double y) { return x > 0 && x < kThickness ? bump(y) : 0.0; });
    sheet_errors.push_back(std::abs(one.penalty() - sheet) / sheet);
    slab_errors.push_back(std::abs(two.penalty() - slab) / slab);
  }
  expect_second_order(sheet_errors, "sheet");
  expect_second_order(slab_errors, "slab");
}

INSTANTIATE_TEST_SUITE_P(Kernels, SheetSuite, ::testing::ValuesIn(SheetSuite::kernels()),
                         [](const auto& info) { return info.param.name; });
INSTANTIATE_TEST_SUITE_P(Kernels, RefinementSuite, ::testing::ValuesIn(testing::named_kernels()),
                         [](const auto& info) { return info.param.name; });

}  // namespace
}  // namespace saltus
