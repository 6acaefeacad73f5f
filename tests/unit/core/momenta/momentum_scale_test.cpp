#include "core/momenta/momentum_scale.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "tests/support/finite_differences.h"
#include "tests/support/random_fields.h"
#include "tests/unit/core/momenta/momentum_scale_cases.h"

namespace saltus {
namespace {

using testing::dot;
using testing::Momenta;
using testing::MomentumScaleTest;
using testing::random_values;

/// Index difference of two sites along each axis.
template <int Dim>
Index<Dim> index_of(const Lattice<Dim>& where, std::size_t site) {
  Index<Dim> index;
  for (int axis = 0; axis < Dim; ++axis) {
    index[axis] = static_cast<int>(site % static_cast<std::size_t>(where.size[axis]));
    site /= static_cast<std::size_t>(where.size[axis]);
  }
  return index;
}

/// The matrices of a scale, entry by entry: sums over components of products of one-dimensional taps (which
/// tests/conformance/kernels checks).
template <int Dim>
class Dense {
 public:
  explicit Dense(const MomentumScaleOptions<Dim>& made) : made_(made) {
    for (const KernelComponent& component : made.kernel.components()) {
      taps_.emplace_back();
      for (int axis = 0; axis < Dim; ++axis)
        taps_.back()[axis] = cell_averaged_taps(*component.profile, made.lattice.spacing[axis]);
    }
  }

  /// sample <- sample, or sample <- face of `axis`.
  double velocity_entry(std::size_t to, std::size_t from, int order) const {
    return sum(to, from, order < 0 ? 0 : 1,
               [&](int axis) { return axis == order ? &KernelTaps::slope : &KernelTaps::value; }, {});
  }
  /// What v_i has with itself.
  double gram_entry(std::size_t to, std::size_t from, int order) const {
    return sum(to, from, order < 0 ? 0 : 2,
               [&](int axis) { return axis == order ? &KernelTaps::curvature : &KernelTaps::value; }, {});
  }
  /// (element of order `left` | K element of order `right`); -1 is order 0. <d m, K d m> = -<m, K'' m>.
  double energy_entry(std::size_t to, std::size_t from, int left, int right) const {
    return sum(
        to, from, (left < 0 ? 0 : 1) + (right < 0 ? 0 : 1),
        [&](int axis) {
          return axis == left && axis == right   ? &KernelTaps::curvature
                 : axis == left || axis == right ? &KernelTaps::slope_gram
                                                 : &KernelTaps::value;
        },
        [&](int axis) { return axis == left && axis != right; });
  }

 private:
  /// Each derivative of component q carries sigma of the whole, where its taps carry sigma_q.
  template <class Choose>
  double sum(std::size_t to, std::size_t from, int derivatives, Choose&& choose,
             const std::function<bool(int)>& is_transposed) const {
    const Index<Dim> a = index_of(made_.lattice, to), b = index_of(made_.lattice, from);
    double total = 0;
    for (std::size_t q = 0; q < taps_.size(); ++q) {
      const KernelComponent& component = made_.kernel.components()[q];
      double value = component.weight * std::pow(made_.kernel.width() / component.profile->width(), derivatives);
      for (int axis = 0; axis < Dim; ++axis) {
        int t = a[axis] - b[axis];
        if (is_transposed && is_transposed(axis)) t = -t;
        const KernelTaps& taps = taps_[q][axis];
        value *= std::abs(t) <= taps.radius ? (taps.*choose(axis))[static_cast<std::size_t>(t + taps.radius)] : 0.0;
      }
      total += value;
    }
    return total;
  }

  const MomentumScaleOptions<Dim>& made_;
  std::vector<std::array<KernelTaps, Dim>> taps_;
};

// Oracle: the dense sum over all sites.
template <int Dim>
void expect_velocity_of_dense_sum(const MomentumScaleOptions<Dim>& made) {
  MomentumScale<Dim, double> scale(made);
  const Momenta<Dim> m(scale, 1);
  std::vector<double> velocity(scale.field_size(), 1e300);
  scale.synthesise(m.zeroth_or_null(), m.first_or_null(), velocity.data());
  const Dense<Dim> dense(made);
  const std::size_t sites = made.lattice.sites();
  for (std::size_t to = 0; to < sites; to += 7)
    for (int c = 0; c < Dim; ++c) {
      double expected = 0;
      for (std::size_t from = 0; from < sites; ++from) {
        if (!m.zeroth.empty())
          expected += made.zeroth_weight * dense.velocity_entry(to, from, -1) * m.zeroth[Dim * from + c];
        for (int axis = 0; axis < Dim && !m.first.empty(); ++axis)
          expected +=
              made.first_weight * dense.velocity_entry(to, from, axis) * m.first[Dim * (sites * axis + from) + c];
      }
      ASSERT_NEAR(velocity[Dim * to + c], expected, 1e-12) << "site " << to << " component " << c;
    }
}

TEST_P(MomentumScaleTest, SynthesisesTheDenseKernelSum) {
  expect_velocity_of_dense_sum<2>(made<2>());
  expect_velocity_of_dense_sum<3>(made<3>());
}

// Oracle: <S m, w> = <m, S^T w>.
template <int Dim>
void expect_transpose(const MomentumScaleOptions<Dim>& made) {
  MomentumScale<Dim, double> scale(made);
  const Momenta<Dim> m(scale, 3);
  const std::vector<double> w = random_values(scale.field_size(), 5);
  std::vector<double> velocity(scale.field_size()), zeroth(scale.field_size()), first(Dim * scale.field_size());
  scale.synthesise(m.zeroth_or_null(), m.first_or_null(), velocity.data());
  scale.synthesise_transpose(w.data(), zeroth.data(), scale.has_first_order() ? first.data() : nullptr);
  const double left = dot(velocity, w);
  double right = 0;
  if (!m.zeroth.empty()) right += dot(m.zeroth, zeroth);
  if (!m.first.empty()) right += dot(m.first, first);
  EXPECT_NEAR(left, right, 1e-12 * std::sqrt(dot(velocity, velocity) * dot(w, w)));
}

TEST_P(MomentumScaleTest, HasAnExactTranspose) {
  expect_transpose<2>(made<2>());
  expect_transpose<3>(made<3>());
}

// Oracle: the quadratic form entry by entry, and central differences (exact for a quadratic) for its gradient.
template <int Dim>
void expect_penalty(const MomentumScaleOptions<Dim>& made) {
  MomentumScale<Dim, double> scale(made);
  const Momenta<Dim> m(scale, 7), along(scale, 9);
  std::vector<double> zeroth(m.zeroth.size()), first(m.first.size());
  const auto penalty = [&](const Momenta<Dim>& at) {
    return scale.penalty(at.zeroth_or_null(), at.first_or_null(), zeroth.data(), first.data());
  };
  const Dense<Dim> dense(made);
  const std::size_t sites = made.lattice.sites();
  const auto form = [&](const double* field, int order, double weight) {
    double sum = 0;
    for (std::size_t to = 0; to < sites; ++to)
      for (std::size_t from = 0; from < sites; ++from) {
        const double entry = dense.gram_entry(to, from, order);
        for (int c = 0; c < Dim && entry != 0; ++c) sum += field[Dim * to + c] * entry * field[Dim * from + c];
      }
    return 0.5 * weight * made.lattice.cell_volume() * sum;
  };
  double expected = 0;
  if (!m.zeroth.empty()) expected += form(m.zeroth.data(), -1, made.zeroth_weight);
  for (int axis = 0; axis < Dim && !m.first.empty(); ++axis)
    expected += form(m.first.data() + Dim * sites * axis, axis, made.first_weight);
  EXPECT_GT(expected, 0);

  Momenta<Dim> up = m, down = m;
  up.zeroth = testing::moved(m.zeroth, 0.5, along.zeroth), up.first = testing::moved(m.first, 0.5, along.first);
  down.zeroth = testing::moved(m.zeroth, -0.5, along.zeroth), down.first = testing::moved(m.first, -0.5, along.first);
  const double slope = penalty(up) - penalty(down);
  EXPECT_NEAR(penalty(m), expected, 1e-12 * expected);
  EXPECT_NEAR(dot(zeroth, along.zeroth) + dot(first, along.first), slope, 1e-11 * expected);
}

// Oracle: the penalty of the momenta themselves.
template <int Dim>
void expect_penalty_of_velocity(const MomentumScaleOptions<Dim>& made) {
  MomentumScale<Dim, double> scale(made);
  const Momenta<Dim> m(scale, 7);
  const std::size_t field = scale.field_size();
  std::vector<double> velocity(field), gradient(field), expected(field);
  const double penalty = scale.penalty(m.zeroth.data(), nullptr, expected.data(), nullptr);
  scale.synthesise(m.zeroth.data(), nullptr, velocity.data());
  EXPECT_NEAR(scale.penalty_of_velocity(m.zeroth.data(), velocity.data(), gradient.data()), penalty, 1e-13 * penalty);
  double largest = 0;
  for (double value : expected) largest = std::max(largest, std::abs(value));
  for (std::size_t i = 0; i < field; ++i) ASSERT_NEAR(gradient[i], expected[i], 1e-14 * largest) << i;
}

TEST_P(MomentumScaleTest, FindsThePenaltyOfOrderZeroInItsVelocity) {
  if (GetParam().orders == Orders::First) return;  // there is no order 0
  MomentumScaleOptions<2> plane = made<2>();
  MomentumScaleOptions<3> space = made<3>();
  plane.orders = space.orders = Orders::Zeroth;
  expect_penalty_of_velocity<2>(plane);
  expect_penalty_of_velocity<3>(space);
}

TEST_P(MomentumScaleTest, PenalisesTheQuadraticFormOfEachOrder) {
  expect_penalty<2>(made<2>());
  expect_penalty<3>(made<3>());
}

// Oracle: 1/2 (rho | K rho) summed over all pairs of orders and sites.
template <int Dim>
void expect_total_energy(const MomentumScaleOptions<Dim>& made) {
  MomentumScale<Dim, double> scale(made);
  const Momenta<Dim> m(scale, 11);
  const Dense<Dim> dense(made);
  const std::size_t sites = made.lattice.sites();
  // Per momentum of order 1 the velocity carries a_1 where order 0 has a_0; (m_1 | K m_1) has the square of the unit.
  const double a = scale.channel_weight(), ratio = made.first_weight / a;
  double expected = 0;
  for (int left = -1; left < Dim; ++left)
    for (int right = -1; right < Dim; ++right) {
      if ((left < 0 || right < 0) && m.zeroth.empty()) continue;
      if ((left >= 0 || right >= 0) && m.first.empty()) continue;
      const double* to_field = left < 0 ? m.zeroth.data() : m.first.data() + Dim * sites * left;
      const double* from_field = right < 0 ? m.zeroth.data() : m.first.data() + Dim * sites * right;
      const double factor = 0.5 * a * made.lattice.cell_volume() * (left < 0 ? 1 : ratio) * (right < 0 ? 1 : ratio);
      for (std::size_t to = 0; to < sites; ++to)
        for (std::size_t from = 0; from < sites; ++from) {
          const double entry = factor * dense.energy_entry(to, from, left, right);
          for (int c = 0; c < Dim && entry != 0; ++c)
            expected += to_field[Dim * to + c] * entry * from_field[Dim * from + c];
        }
    }
  EXPECT_GT(expected, 0);
  EXPECT_NEAR(scale.total_energy(m.zeroth_or_null(), m.first_or_null()), expected, 1e-12 * expected);
}

TEST_P(MomentumScaleTest, HasTheTotalEnergyOfAllPairsOfOrders) {
  expect_total_energy<2>(made<2>());
  expect_total_energy<3>(made<3>());
}

INSTANTIATE_TEST_SUITE_P(Orders, MomentumScaleTest, testing::all_orders_cases(),
                         [](const auto& info) { return name_of(info.param); });

/// A smooth bump on 48 x 48 mm, its value and gradient with respect to mm.
struct Bump {
  static Lattice<2> lattice(int per_mm) { return {{48 * per_mm, 48 * per_mm}, {1.0 / per_mm, 1.0 / per_mm}, {}}; }
  static double at(double x, double y) { return std::exp(-((x - 23) * (x - 23) + 1.4 * (y - 25) * (y - 25)) / 60); }
  static double dx(double x, double y) { return -2 * (x - 23) / 60 * at(x, y); }
  static double dy(double x, double y) { return -2.8 * (y - 25) / 60 * at(x, y); }
};

/// Zeroth and first-order momenta from functions of the place where each component sits (order 1: at the faces).
struct SampledMomenta {
  std::vector<double> zeroth, first;
  template <class F0, class Fx, class Fy>
  SampledMomenta(const Lattice<2>& where, F0&& f0, Fx&& fx, Fy&& fy) {
    const std::size_t field = 2 * where.sites();
    const double h = where.spacing[0];
    zeroth.assign(field, 0.0);
    first.assign(2 * field, 0.0);
    for (std::size_t site = 0; site < where.sites(); ++site) {
      const Index<2> i = index_of(where, site);
      for (int c = 0; c < 2; ++c) {
        const double share = c == 0 ? 1.0 : -0.6;
        zeroth[2 * site + c] = share * f0(i[0] * h, i[1] * h);
        first[2 * site + c] = share * fx((i[0] + 0.5) * h, i[1] * h);
        first[field + 2 * site + c] = share * fy(i[0] * h, (i[1] + 0.5) * h);
      }
    }
  }
};

/// Energy and velocity of momenta that together make no element, as shares of what m_x (or m_y) alone makes.
std::vector<double> what_is_left(KernelSum kernel, int per_mm) {
  const Lattice<2> where = Bump::lattice(per_mm);
  MomentumScale<2, double> scale({std::move(kernel), where, Orders::ZerothAndFirst, 1.0, 0.5});
  const double unit = scale.first_order_unit();
  const auto zero = [](double, double) { return 0.0; };
  const SampledMomenta cases[] = {
      {where, [&](double x, double y) { return -unit * Bump::dx(x, y); }, Bump::at, zero},
      {where, [&](double x, double y) { return -unit * Bump::dy(x, y); }, zero, Bump::at},
      {where, zero, Bump::dy, [](double x, double y) { return -Bump::dx(x, y); }},
  };
  std::vector<double> shares, v(scale.field_size()), alone(scale.field_size());
  const std::vector<double> nothing(scale.field_size(), 0.0);
  for (const SampledMomenta& m : cases) {
    std::vector<double> one = m.first;  // m_x, or m_y where there is no m_x
    const auto middle = one.begin() + static_cast<std::ptrdiff_t>(scale.field_size());
    if (std::any_of(one.begin(), middle, [](double value) { return value != 0; })) std::fill(middle, one.end(), 0.0);
    scale.synthesise(m.zeroth.data(), m.first.data(), v.data());
    scale.synthesise(nothing.data(), one.data(), alone.data());
    shares.push_back(std::sqrt(dot(v, v) / dot(alone, alone)));
    shares.push_back(std::abs(scale.total_energy(m.zeroth.data(), m.first.data())) /
                     scale.total_energy(nothing.data(), one.data()));
  }
  return shares;
}

// Oracle: rho = m_0 + unit (d_x m_x + d_y m_y) = 0 has no velocity and no energy; a wrong sign or factor of any cross
// term leaves as much as there was. What the spacing leaves falls with its square.
TEST(MomentumScaleCancellation, OfOrdersThatMakeNoElementLeavesNothing) {
  for (const char* name : {"gaussian", "wendland", "sum"}) {
    SCOPED_TRACE(name);
    const KernelSum kernel = name[0] == 'g' ? KernelSum(make_gaussian_profile(6))
                             : name[0] == 'w'
                                 ? KernelSum(make_wendland_profile(9))
                                 : KernelSum({{1.0, make_wendland_profile(7)}, {0.5, make_wendland_profile(12)}});
    const std::vector<double> coarse = what_is_left(kernel, 1), fine = what_is_left(kernel, 2);
    for (std::size_t k = 0; k < coarse.size(); ++k) {
      EXPECT_LT(coarse[k], 0.03);
      EXPECT_LT(fine[k], 0.3 * coarse[k] + 1e-5);  // the Gaussian is cut at 1e-5
    }
  }
}

// Oracle: closed form. Next to the sheet the velocity is linear in the distance, so extrapolating it from both sides
// gives the jump of the kernel's derivative, -4 / sigma, times a_1 sigma h / mass.
TEST(MomentumScaleSheet, JumpsBetweenTwoNeighbouringSamplesInTheMomentumsDirection) {
  const double sigma = 9, h = 0.75, a1 = 0.8;
  for (int axis : {0, 1}) {
    MomentumScaleOptions<2> made{make_wendland_profile(sigma), {{61, 61}, {h, h}, {}}, Orders::First, 1.0, a1};
    MomentumScale<2, double> scale(made);
    const std::size_t step = axis == 0 ? 1 : 61, across = axis == 0 ? 61 : 1;
    std::vector<double> first(2 * scale.field_size(), 0.0), v(scale.field_size());
    const double momentum[2] = {axis == 0 ? 0.0 : 0.7, axis == 0 ? 0.7 : 0.0};  // tangential to the sheet
    for (std::size_t k = 0; k < 61; ++k)
      for (int c : {0, 1}) first[scale.field_size() * axis + 2 * (30 * step + k * across) + c] = momentum[c];
    scale.synthesise(nullptr, first.data(), v.data());
    const auto along = [&](std::size_t i, int c) { return v[2 * (i * step + 30 * across) + c]; };
    const int tangent = 1 - axis;
    for (std::size_t i = 0; i < 61; ++i) EXPECT_EQ(along(i, axis), 0);  // nothing flows through the sheet
    const double below = along(30, tangent) + 0.5 * (along(30, tangent) - along(29, tangent));
    const double above = along(31, tangent) - 0.5 * (along(32, tangent) - along(31, tangent));
    const double jump = -4 * a1 * h / made.kernel.components().front().profile->mass() * 0.7;
    EXPECT_NEAR(above - below, jump, 1e-12);
    for (std::size_t i = 15; i < 45; ++i)
      if (i != 30) {
        EXPECT_LT(std::abs(along(i + 1, tangent) - along(i, tangent)), 0.05 * std::abs(jump)) << "inside at " << i;
      }
    EXPECT_NEAR(along(30, tangent), -along(31, tangent), 1e-13);
  }
}

TEST(MomentumScaleSheet, KeepsItsJumpWhenTheSpacingIsHalvedAtEqualMomentumPerArea) {
  double jumps[2];
  for (int fine : {0, 1}) {
    const double h = fine ? 0.5 : 1.0;
    const int n = fine ? 80 : 40;
    MomentumScale<2, double> scale({make_wendland_profile(8), {{n, n}, {h, h}, {}}, Orders::First, 1.0, 1.0});
    std::vector<double> first(2 * scale.field_size(), 0.0), v(scale.field_size());
    for (int y = 0; y < n; ++y) first[2 * static_cast<std::size_t>(y * n + n / 2) + 1] = 1 / h;
    scale.synthesise(nullptr, first.data(), v.data());
    const double* at = v.data() + 2 * static_cast<std::size_t>(n / 2 * n + n / 2) + 1;
    jumps[fine] = (at[2] - 0.5 * (at[4] - at[2])) - (at[0] + 0.5 * (at[0] - at[-2]));
  }
  EXPECT_NEAR(jumps[0], jumps[1], 1e-6 * std::abs(jumps[0]));
}

}  // namespace
}  // namespace saltus
