#include "core/flow/geodesic_shooting.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>

#include "core/flow/backward_map.h"
#include "core/momenta/spread_normals.h"
#include "tests/support/finite_differences.h"
#include "tests/support/random_blocks.h"
#include "tests/support/random_fields.h"

namespace saltus {
namespace {

using testing::dot;
using testing::random_field;
using testing::random_values;

Lattice<2> square(int n, double spacing = 1) { return {{n, n}, {spacing, spacing}, {}}; }

/// Two smooth blobs of momentum that pass each other with a strong shear between them.
std::vector<double> passing_blobs(const Lattice<2>& where, double amount) {
  std::vector<double> m(2 * where.sites());
  const double middle = 0.5 * (where.size[0] - 1) * where.spacing[0];
  for (int slab = 0; slab < where.size[1]; ++slab)
    visit_slab<2>(where, slab, [&](const Index<2>& i, std::size_t site) {
      const double x = i[0] * where.spacing[0] - middle, y = i[1] * where.spacing[1] - middle;
      const auto blob = [](double dx, double dy) { return std::exp(-(dx * dx + dy * dy) / 60); };
      m[2 * site] = amount * (blob(x + 5, y - 5) - 0.8 * blob(x - 6, y + 6));
      m[2 * site + 1] = amount * 0.5 * blob(x - 4, y - 7);
    });
  return m;
}

std::vector<double> energies(MomentumScale<2, double>& scale, const MomentumPointers<double>& m, int steps,
                             Evolution evolution) {
  GeodesicShooting<2, double> shooting({&scale}, scale.lattice(), steps, evolution);
  shooting.shoot({m});
  return shooting.hamiltonians({m});
}

double drift(const std::vector<double>& h) {
  double worst = 0;
  for (double value : h) worst = std::max(worst, std::abs(value - h[0]) / h[0]);
  return worst;
}

// Oracle: the Hamiltonian of the geodesic is constant; what is left is the time step's error, of second order, on top
// of what the lattice spreads.
TEST(GeodesicShooting, ConservesEnergyToSecondOrderInTheTimeStep) {
  MomentumScale<2, double> scale({make_gaussian_profile(14), square(96), Orders::Zeroth, 1.0, 1.0});
  const std::vector<double> m = passing_blobs(scale.lattice(), 45);
  const auto final_energy = [&](int steps) {
    return energies(scale, {m.data(), nullptr}, steps, Evolution::Exact).back();
  };
  const double limit = final_energy(48), start = energies(scale, {m.data(), nullptr}, 1, Evolution::Exact).front();
  EXPECT_LT(std::abs(limit - start), 0.01 * start);
  const double at4 = std::abs(final_energy(4) - limit), at8 = std::abs(final_energy(8) - limit);
  EXPECT_GT(at4, 0.002 * start) << "too gentle to show an order";
  EXPECT_NEAR(std::log2(at4 / at8), 2, 0.6) << at4 / start << " then " << at8 / start;
}

// The same with first-order momenta, under a smooth kernel, where the formulas of the transport are exact: the drift
// falls with the spacing. Leaving out a term (as `per_order` does on purpose) does not.
TEST(GeodesicShooting, ConservesEnergyWithFirstOrderMomenta) {
  const auto drift_at = [](int n, double h, Evolution evolution) {
    MomentumScale<2, double> scale({make_gaussian_profile(14), square(n, h), Orders::ZerothAndFirst, 1.0, 0.7});
    const std::vector<double> m0 = passing_blobs(scale.lattice(), 20);
    std::vector<double> m1 = passing_blobs(scale.lattice(), 15), more = passing_blobs(scale.lattice(), -18);
    for (std::size_t i = 0; i + 1 < more.size(); i += 2) std::swap(more[i], more[i + 1]);
    m1.insert(m1.end(), more.begin(), more.end());
    return drift(energies(scale, {m0.data(), m1.data()}, 12, evolution));
  };
  const double coarse = drift_at(48, 2, Evolution::Exact), fine = drift_at(96, 1, Evolution::Exact);
  EXPECT_LT(fine, 0.01);
  EXPECT_LT(fine, 0.5 * coarse);
  EXPECT_GT(drift_at(96, 1, Evolution::PerOrder), 8 * fine);
}

// As above: second order in the time step, with first-order momenta.
TEST(GeodesicShooting, ConservesEnergyWithFirstOrderMomentaToSecondOrderInTheTimeStep) {
  MomentumScale<2, double> scale({make_gaussian_profile(14), square(96), Orders::ZerothAndFirst, 1.0, 0.7});
  const std::vector<double> m0 = passing_blobs(scale.lattice(), 30);
  std::vector<double> m1 = passing_blobs(scale.lattice(), 30), more = passing_blobs(scale.lattice(), -36);
  for (std::size_t i = 0; i + 1 < more.size(); i += 2) std::swap(more[i], more[i + 1]);
  m1.insert(m1.end(), more.begin(), more.end());
  const auto final_energy = [&](int steps) {
    return energies(scale, {m0.data(), m1.data()}, steps, Evolution::Exact).back();
  };
  const double limit = final_energy(48), start = energies(scale, {m0.data(), m1.data()}, 1, Evolution::Exact).front();
  EXPECT_LT(std::abs(limit - start), 0.03 * start);
  const double at4 = std::abs(final_energy(4) - limit), at8 = std::abs(final_energy(8) - limit);
  EXPECT_GT(at4, 0.004 * start) << "too gentle to show an order";
  EXPECT_NEAR(std::log2(at4 / at8), 2, 0.4) << at4 / start << " then " << at8 / start;
}

/// Particles with momenta under v(x) = c sum_j exp(-|x - q_j|^2 / sigma^2) p_j.
struct Particles {
  std::vector<Vector<2>> q, p;
};

Particles rate(const Particles& at, double c, double sigma) {
  Particles change{std::vector<Vector<2>>(at.q.size(), Vector<2>::Zero()),
                   std::vector<Vector<2>>(at.q.size(), Vector<2>::Zero())};
  for (std::size_t i = 0; i < at.q.size(); ++i)
    for (std::size_t j = 0; j < at.q.size(); ++j) {
      const Vector<2> r = at.q[i] - at.q[j];
      const double k = c * std::exp(-r.squaredNorm() / (sigma * sigma));
      change.q[i] += k * at.p[j];
      change.p[i] +=
          2 * k / (sigma * sigma) * at.p[i].dot(at.p[j]) * r;  // -dH/dq_i, the pair counted once from each end
    }
  return change;
}

Particles shifted(const Particles& at, double step, const Particles& change) {
  Particles result = at;
  for (std::size_t i = 0; i < at.q.size(); ++i) result.q[i] += step * change.q[i], result.p[i] += step * change.p[i];
  return result;
}

Particles flow(Particles at, double c, double sigma, int steps) {
  const double dt = 1.0 / steps;
  for (int k = 0; k < steps; ++k) {
    const Particles a = rate(at, c, sigma), b = rate(shifted(at, dt / 2, a), c, sigma),
                    d = rate(shifted(at, dt / 2, b), c, sigma), e = rate(shifted(at, dt, d), c, sigma);
    at = shifted(shifted(shifted(shifted(at, dt / 6, a), dt / 3, b), dt / 3, d), dt / 6, e);
  }
  return at;
}

/// Distance of three particles at t = 1 on a lattice of spacing h from where `flow` has them, as a share of how far
/// they went.
double error_against_particles(double h) {
  const double sigma = 20, a0 = 1.7, strength = 1200;
  const Lattice<2> where = square(static_cast<int>(100 / h) + 1, h);
  MomentumScale<2, double> scale({make_gaussian_profile(sigma), where, Orders::Zeroth, a0, 1.0});
  const double mass = scale.options().kernel.components().front().profile->mass(), c = a0 / (mass * mass);
  const Particles start{{{40, 46}, {52, 52}, {46, 62}},
                        {strength * Vector<2>(9, 4), strength * Vector<2>(-7, 3), strength * Vector<2>(2, -10)}};
  const auto site = [&](const Vector<2>& x) {
    return static_cast<std::size_t>(x[1] / h) * static_cast<std::size_t>(where.size[0]) +
           static_cast<std::size_t>(x[0] / h);
  };
  std::vector<double> m(scale.field_size(), 0.0);
  for (std::size_t i = 0; i < 3; ++i)
    for (int k : {0, 1}) m[2 * site(start.q[i]) + k] = start.p[i][k] / where.cell_volume();
  const Particles end = flow(start, c, sigma, 200);
  GeodesicShooting<2, double> shooting({&scale}, where, 24, Evolution::Exact);
  shooting.shoot({{m.data(), nullptr}});
  const Field<double> moved = forward_map<2, double>(where, where, shooting.velocities());
  double worst = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    const Vector<2> expected = end.q[i] - start.q[i],
                    found(moved[2 * site(start.q[i])], moved[2 * site(start.q[i]) + 1]);
    EXPECT_GT(expected.norm(), 3);
    // Were momenta only carried along straight lines the answer would be another one, so that this test sees them turn.
    EXPECT_GT((rate(start, c, sigma).q[i] - expected).norm(), 0.1 * expected.norm());
    worst = std::max(worst, (found - expected).norm() / expected.norm());
  }
  return worst;
}

// Oracle: Hamilton's equations of three particles, by fourth-order Runge-Kutta. On the lattice each is a momentum at
// one site; the error is what the spacing leaves and falls with it.
TEST(GeodesicShooting, MovesParticlesAsHamiltonsEquationsDo) {
  const double coarse = error_against_particles(2), fine = error_against_particles(1);
  EXPECT_LT(fine, 0.02);
  EXPECT_LT(fine, 0.4 * coarse) << "coarse " << coarse << ", fine " << fine;
}

// Oracle: conservation. Carried momenta keep their sum at every node, and so does the velocity they make in the mean.
TEST(GeodesicShooting, CarriesTheTotalMomentum) {
  MomentumScale<2, double> scale({make_gaussian_profile(5), square(64), Orders::Zeroth, 1.0, 1.0});
  std::vector<double> m = passing_blobs(scale.lattice(), 2);
  GeodesicShooting<2, double> shooting({&scale}, scale.lattice(), 5, Evolution::Carried);
  shooting.shoot({{m.data(), nullptr}});
  for (int c : {0, 1}) {
    double total = 0;
    for (std::size_t i = static_cast<std::size_t>(c); i < m.size(); i += 2) total += m[i];
    for (const Field<double>& v : shooting.velocities()) {
      double flux = 0;  // the kernel has unit mass
      for (std::size_t i = static_cast<std::size_t>(c); i < v.size(); i += 2) flux += v[i];
      EXPECT_NEAR(flux, total, 1e-3 * std::abs(total));
    }
  }
}

// Oracle: closed form. A layer of first-order momenta makes a shear flow, whose parallel lines carry it onto itself.
TEST(GeodesicShooting, KeepsAParallelShearFlowSteadyWhenCarried) {
  constexpr int width = 120, height = 32;
  const Lattice<2> where{{width, height}, {1, 1}, {}};
  MomentumScale<2, double> scale({make_wendland_profile(8), where, Orders::First, 1.0, 1.0});
  std::vector<double> m(2 * scale.field_size(), 0.0);
  for (int x = 0; x < width; ++x)
    m[scale.field_size() + 2 * static_cast<std::size_t>(width * 15 + x)] = 6;  // m_y along x
  GeodesicShooting<2, double> shooting({&scale}, scale.lattice(), 4, Evolution::Carried);
  shooting.shoot({{nullptr, m.data()}});
  const Field<double>& first = shooting.velocities().front();
  double fastest = 0;
  for (double v : first) fastest = std::max(fastest, std::abs(v));
  EXPECT_GT(fastest, 1);
  // Away from both ends of the layer, where the flow is not parallel.
  for (const Field<double>& v : shooting.velocities())
    for (int y = 0; y < height; ++y)
      for (int x = 45; x < 75; ++x)
        for (int c : {0, 1}) {
          const std::size_t at = static_cast<std::size_t>(2 * (width * y + x) + c);
          ASSERT_NEAR(v[at], first[at], 1e-12 * fastest) << x << " " << y;
        }
}

// Oracle: the same shooting with one step of the map in each of its own, and means.
TEST(GeodesicShooting, IsLinearInTimeBetweenItsSteps) {
  MomentumScale<2, double> scale({make_gaussian_profile(8), square(24), Orders::Zeroth, 1.0, 1.0});
  const std::vector<double> m = passing_blobs(scale.lattice(), 20);
  GeodesicShooting<2, double> coarse({&scale}, scale.lattice(), 2, Evolution::Exact),
      fine({&scale}, scale.lattice(), 2, Evolution::Exact, 4);
  coarse.shoot({{m.data(), nullptr}});
  fine.shoot({{m.data(), nullptr}});
  ASSERT_EQ(coarse.velocities().size(), 3u);
  ASSERT_EQ(fine.velocities().size(), 9u);
  for (int node = 0; node <= 8; ++node) {
    const int step = std::min(node / 4, 1);
    const double share = (node - 4 * step) / 4.0;
    const Field<double>&before = coarse.velocities()[step], &after = coarse.velocities()[step + 1];
    for (std::size_t i = 0; i < before.size(); ++i)
      ASSERT_NEAR(fine.velocities()[node][i], (1 - share) * before[i] + share * after[i], 1e-14) << node << " " << i;
  }
  EXPECT_EQ(fine.hamiltonians({{m.data(), nullptr}}), coarse.hamiltonians({{m.data(), nullptr}}));
}

// Two scales that share a lattice, one on a coarser one, and oriented momenta: all have their part in it, whatever was
// shot before.
TEST(GeodesicShooting, StartsWithTheVelocityOfItsFirstNode) {
  MomentumScale<2, double> wide({make_gaussian_profile(8), square(24), Orders::Zeroth, 1.0, 1.0}),
      narrow({make_wendland_profile(3), square(24), Orders::ZerothAndFirst, 1.0, 1.0, {}, spread_normals<2>(4)}),
      coarse({make_gaussian_profile(9), square(12, 2), Orders::Zeroth, 1.0, 1.0});
  const std::vector<double> m = passing_blobs(wide.lattice(), 20), first = random_values(4 * 24 * 24, 5),
                            other = random_values(2 * 12 * 12, 6), along = random_values(3, 7);
  const std::vector<std::uint32_t> elements = {200, 900, 1500};
  const std::vector<MomentumPointers<double>> momenta = {
      {m.data(), nullptr}, {m.data(), first.data(), &elements, along.data()}, {other.data(), nullptr}};
  const auto shooting_of = [&] {
    return GeodesicShooting<2, double>({&wide, &narrow, &coarse}, wide.lattice(), 3, Evolution::Carried, 2);
  };
  auto whole = shooting_of();
  whole.shoot(momenta);

  const std::vector<double> zero(first.size(), 0.0);
  const std::vector<std::uint32_t> no_elements;
  const auto none = BlockSet<2>::none(wide.lattice());
  const std::vector<MomentumPointers<double>> others = {
      {zero.data(), nullptr}, {m.data(), zero.data(), &no_elements, nullptr}, {zero.data(), nullptr}};
  ActiveBlocks<2> blocks;
  blocks.momenta = blocks.wanted = {{}, {&none, &none}, {}};
  auto shooting = shooting_of();
  shooting.shoot(others, blocks);
  ASSERT_NE(shooting.velocities()[0], whole.velocities()[0]);
  EXPECT_EQ(shooting.starting_velocity(momenta), whole.velocities()[0]);
  std::vector<Field<double>> duals(shooting.velocities().size(), shooting.velocities()[0]);
  EXPECT_THROW(shooting.adjoint(momenta, duals, {}, {}), std::logic_error);
  shooting.shoot(momenta);
  EXPECT_EQ(shooting.velocities(), whole.velocities());
}

// Oracle: central differences of a linear functional of all velocities, with two scales on different lattices.
TEST(GeodesicShooting, HasAnExactAdjoint) {
  const Lattice<2> fine = {{14, 12}, {1, 1.2}, {}};
  for (const auto& [evolution, map_steps] : {std::pair{Evolution::Exact, 1}, std::pair{Evolution::PerOrder, 1},
                                             std::pair{Evolution::Carried, 1}, std::pair{Evolution::Carried, 3}}) {
    MomentumScale<2, double> wide({make_gaussian_profile(5), coarsened(fine, 2.0), Orders::Zeroth, 2.0, 1.0});
    MomentumScale<2, double> narrow({make_wendland_profile(4), fine, Orders::ZerothAndFirst, 1.0, 0.5});
    GeodesicShooting<2, double> shooting({&wide, &narrow}, fine, 3, evolution, map_steps);
    const int steps = shooting.nodes() - 1;
    ASSERT_EQ(steps, 3 * map_steps);
    const std::size_t a = wide.field_size(), b = narrow.field_size(), whole = a + 3 * b;
    const std::vector<double> m = random_values(whole, 1, 0.1), along = random_values(whole, 2),
                              duals = random_values(2 * fine.sites() * (steps + 1), 3);
    const auto pointers = [&](const std::vector<double>& x) {
      return std::vector<MomentumPointers<double>>{{x.data(), nullptr}, {x.data() + a, x.data() + a + b}};
    };
    const double slope = testing::slope_along(
        [&](const std::vector<double>& x) {
          shooting.shoot(pointers(x));
          double sum = 0;
          for (int k = 0; k <= steps; ++k)
            for (std::size_t i = 0; i < 2 * fine.sites(); ++i)
              sum += duals[2 * fine.sites() * k + i] * shooting.velocities()[k][i];
          return sum;
        },
        m, along, 1e-7);
    std::vector<Field<double>> velocity_duals;
    for (int k = 0; k <= steps; ++k)
      velocity_duals.emplace_back(duals.begin() + 2 * fine.sites() * k, duals.begin() + 2 * fine.sites() * (k + 1));
    std::vector<double> gradient(whole, 0.0), preconditioned(whole, 0.0);
    const auto targets = [&](std::vector<double>& x) {
      return std::vector<MomentumTargets<double>>{{x.data(), nullptr}, {x.data() + a, x.data() + a + b}};
    };
    shooting.shoot(pointers(m));
    shooting.adjoint(pointers(m), velocity_duals, targets(gradient), targets(preconditioned));
    EXPECT_NEAR(dot(gradient, along), slope, 1e-6 * std::sqrt(dot(gradient, gradient) * dot(along, along)));
    EXPECT_GT(dot(preconditioned, preconditioned), 0);
  }
}

// Oracle: the same shooting without blocks. One axis has a few blocks, one all of them or none.
TEST(GeodesicShooting, NeedsOnlyTheBlocksThatAreNotZero) {
  const Lattice<2> lattice = {{22, 18}, {1, 1.2}, {}};
  const BlockSet<2> some(lattice, {2, 7, 8, 20}), none = BlockSet<2>::none(lattice);
  for (Evolution evolution : {Evolution::Exact, Evolution::PerOrder, Evolution::Carried})
    for (const AxisBlocks<2>& blocks :
         {AxisBlocks<2>{&some, &none}, AxisBlocks<2>{nullptr, &some}, AxisBlocks<2>{&none, &none}}) {
      MomentumScale<2, double> scale({make_wendland_profile(4), lattice, Orders::ZerothAndFirst, 1.0, 0.5});
      constexpr int steps = 3;
      GeodesicShooting<2, double> shooting({&scale}, lattice, steps, evolution);
      const std::size_t field = scale.field_size();
      const std::vector<double> zeroth = random_values(field, 1, 0.1);
      std::vector<double> first = random_values(2 * field, 2, 0.1);
      std::vector<char> is_inside(2 * field, 0);
      for (int axis = 0; axis < 2; ++axis) {
        const BlockSet<2> within = blocks[axis] ? *blocks[axis] : BlockSet<2>::all(lattice);
        for (int slab = 0; slab < lattice.size[1]; ++slab)
          within.visit_slab(slab, [&](const Index<2>& index, std::size_t site) {
            EXPECT_EQ(site, static_cast<std::size_t>(index[1] * lattice.size[0] + index[0]));
            EXPECT_EQ(index[1], slab);
            is_inside[axis * field + 2 * site] = is_inside[axis * field + 2 * site + 1] = 1;
          });
      }
      for (std::size_t i = 0; i < first.size(); ++i) first[i] *= is_inside[i];

      const auto run = [&](const ActiveBlocks<2>& within, std::vector<double>& gradient) {
        shooting.shoot({{zeroth.data(), first.data()}}, within);
        std::vector<Field<double>> velocities = shooting.velocities(), duals;
        for (int k = 0; k <= steps; ++k) duals.push_back(random_field(field, 10 + k));
        gradient.assign(3 * field, 0.0);
        std::vector<double> preconditioned(field, 0.0);
        shooting.adjoint({{zeroth.data(), first.data()}}, duals, {{gradient.data(), gradient.data() + field}},
                         {{preconditioned.data(), nullptr}});
        return velocities;
      };
      std::vector<double> everywhere, inside;
      const auto expected = run({}, everywhere), found = run({{blocks}, {blocks}}, inside);
      for (int k = 0; k <= steps; ++k)
        for (std::size_t i = 0; i < field; ++i) ASSERT_NEAR(found[k][i], expected[k][i], 1e-14) << k << " " << i;
      for (std::size_t i = 0; i < field; ++i) ASSERT_NEAR(inside[i], everywhere[i], 1e-12) << i;
      for (std::size_t i = 0; i < 2 * field; ++i) {
        if (!is_inside[i]) continue;
        ASSERT_NEAR(inside[field + i], everywhere[field + i], 1e-12) << i;
      }
    }
}

// First orders alone on a lattice: only sites around active blocks move. A second scale on the same lattice, with
// blocks of its own, and a coarse one with order 0. Oracle: all sites; outside the active blocks momenta are a NaN.
template <int Dim>
void expect_same_from_active_blocks(Evolution evolution, double share, bool looks_everywhere) {
  Lattice<Dim> fine;
  fine.spacing.fill(1.1);
  for (int axis = 0; axis < Dim; ++axis) fine.size[axis] = Dim == 2 ? 37 - 3 * axis : 22 - axis;
  MomentumScale<Dim, double> wide({make_gaussian_profile(5), coarsened(fine, 2.2), Orders::Zeroth, 2.0, 1.0});
  MomentumScale<Dim, double> narrow({make_wendland_profile(3), fine, Orders::First, 1.0, 0.5});
  MomentumScale<Dim, double> other({make_wendland_profile(2), fine, Orders::First, 1.0, 0.8});
  constexpr int steps = 3;
  GeodesicShooting<Dim, double> shooting({&wide, &narrow, &other}, fine, steps, evolution);
  const std::size_t a = wide.field_size(), field = narrow.field_size(), whole = a + 2 * Dim * field;
  std::vector<double> zeros = random_values(whole, 1, 0.1), nans = zeros;
  ActiveBlocks<Dim> some{std::vector<AxisBlocks<Dim>>(3), std::vector<AxisBlocks<Dim>>(3)}, all = some;
  std::vector<BlockSet<Dim>> sets;
  sets.reserve(2 * Dim);
  std::vector<char> is_wanted(whole, 1);
  for (std::size_t scale : {1, 2})
    for (std::size_t axis = 0; axis < Dim; ++axis) {
      const auto mask = testing::random_blocks<Dim>(fine, 100 * scale + axis, share);
      std::vector<std::uint32_t> active;
      for (std::size_t b = 0; b < BlockSet<Dim>::none(fine).blocks(); ++b)
        if (mask[b]) active.push_back(static_cast<std::uint32_t>(b));
      sets.emplace_back(fine, active);
      some.momenta[scale][axis] = &sets.back();
      if (!looks_everywhere) some.wanted[scale][axis] = &sets.back();
      const std::vector<char> flags = testing::site_flags<Dim>(fine, mask);
      const std::size_t begin = a + ((scale - 1) * Dim + axis) * field;
      for (std::size_t i = 0; i < field; ++i) {
        if (flags[i / Dim]) continue;
        zeros[begin + i] = 0;
        nans[begin + i] = std::numeric_limits<double>::quiet_NaN();
        is_wanted[begin + i] = looks_everywhere;
      }
    }
  // A look reads momenta everywhere: they are 0 there.
  if (looks_everywhere) nans = zeros;
  const auto split = [&](auto* x, auto&& make) {
    using Part = decltype(make(x, x));
    return std::vector<Part>{make(x, static_cast<decltype(x)>(nullptr)), make(static_cast<decltype(x)>(nullptr), x + a),
                             make(static_cast<decltype(x)>(nullptr), x + a + Dim * field)};
  };
  const auto run = [&](GeodesicShooting<Dim, double>& shooting, const std::vector<double>& m,
                       const ActiveBlocks<Dim>& blocks, std::vector<double>& gradient) {
    const auto pointers = split(m.data(), [](const double* zeroth, const double* first) {
      return MomentumPointers<double>{zeroth, first};
    });
    std::vector<double> preconditioned(whole, 0.0);
    gradient.assign(whole, 0.0);
    const auto target = [](double* zeroth, double* first) { return MomentumTargets<double>{zeroth, first}; };
    shooting.shoot(pointers, blocks);
    std::vector<Field<double>> velocities = shooting.velocities(), duals;
    for (int k = 0; k <= steps; ++k) duals.push_back(random_field(field, 10 + k));
    std::vector<MomentumTargets<double>> scaled = split(preconditioned.data(), target);
    scaled[1] = scaled[2] = {};
    shooting.adjoint(pointers, duals, split(gradient.data(), target), scaled);
    gradient.insert(gradient.end(), preconditioned.begin(), preconditioned.begin() + static_cast<std::ptrdiff_t>(a));
    return velocities;
  };
  std::vector<double> expected_gradient, gradient;
  const auto expected = run(shooting, zeros, all, expected_gradient);
  // Another one, in which nothing but NaN is left of what was before, and in the scratch of the scales too.
  GeodesicShooting<Dim, double> poisoned({&wide, &narrow, &other}, fine, steps, evolution);
  run(poisoned, std::vector<double>(whole, std::numeric_limits<double>::quiet_NaN()), all, gradient);
  const auto found = run(poisoned, nans, some, gradient);
  for (int k = 0; k <= steps; ++k)
    for (std::size_t i = 0; i < field; ++i) ASSERT_NEAR(found[k][i], expected[k][i], 1e-13) << k << " " << i;
  is_wanted.resize(gradient.size(), 1);
  for (std::size_t i = 0; i < gradient.size(); ++i)
    if (is_wanted[i]) {
      ASSERT_NEAR(gradient[i], expected_gradient[i], 1e-11) << i;
    }
}

TEST(GeodesicShooting, MovesOnlySitesAroundActiveBlocks) {
  for (Evolution evolution : {Evolution::Exact, Evolution::PerOrder, Evolution::Carried})
    for (bool looks_everywhere : {false, true})
      for (double share : {0.0, 0.02, 0.15}) {
        SCOPED_TRACE(share);
        expect_same_from_active_blocks<2>(evolution, share, looks_everywhere);
        expect_same_from_active_blocks<3>(evolution, share, looks_everywhere);
      }
}

// Oracle: the same scale with fields of first orders beside its elements, all of which are 0.
TEST(GeodesicShooting, NeedsNoFieldsWhereThereAreElementsAlone) {
  const Lattice<2> fine = square(36), coarse = square(18, 2);
  const std::vector<double> zero(4 * fine.sites(), 0.0);
  // Elements on the lattice of the velocity, and on one that is coarser.
  for (const Lattice<2>& lattice : {fine, coarse}) {
    const Lattice<2>& others = lattice == fine ? coarse : fine;
    MomentumScale<2, double> wide({make_gaussian_profile(8), others, Orders::Zeroth, 1.0, 1.0});
    const std::vector<double> m = passing_blobs(others, 20);
    for (Evolution evolution : {Evolution::Carried, Evolution::Exact}) {
      for (int steps : {1, 3}) {
        struct Found {
          std::vector<Field<double>> velocities;
          std::vector<double> zeroth, oriented, energies;
        };
        const auto run = [&](Orders orders) {
          MomentumScaleOptions<2> options{make_wendland_profile(7), lattice, orders, 1.0, 1.5};
          options.normals = spread_normals<2>(8);
          MomentumScale<2, double> scale(options);
          std::vector<std::uint32_t> elements;
          for (std::uint32_t e = 100; e < scale.oriented()->elements(); e += 431) elements.push_back(e);
          const std::vector<double> values = random_values(elements.size(), 5);
          const bool has_fields = orders == Orders::First;
          const std::vector<MomentumPointers<double>> momenta = {
              {m.data(), nullptr}, {nullptr, has_fields ? zero.data() : nullptr, &elements, values.data()}};
          GeodesicShooting<2, double> shooting({&wide, &scale}, fine, steps, evolution);
          shooting.shoot(momenta);
          Found found{
              shooting.velocities(), std::vector<double>(m.size(), 0.0), std::vector<double>(values.size(), 0.0), {}};
          std::vector<Field<double>> duals;
          for (int k = 0; k <= steps; ++k) duals.push_back(random_field(2 * fine.sites(), 10 + k));
          std::vector<double> of_fields(zero.size(), 0.0), preconditioned(m.size(), 0.0);
          shooting.adjoint(momenta, duals,
                           {{found.zeroth.data(), nullptr},
                            {nullptr, has_fields ? of_fields.data() : nullptr, found.oriented.data()}},
                           {{preconditioned.data(), nullptr}, {}});
          if (evolution == Evolution::Exact) found.energies = shooting.hamiltonians(momenta);
          return found;
        };
        const Found beside = run(Orders::First), alone = run(Orders::Oriented);
        EXPECT_EQ(alone.energies, beside.energies);
        const auto expect_alike = [](const auto& one, const auto& other) {
          double most = 0;
          for (double value : other) most = std::max(most, std::abs(value));
          ASSERT_GT(most, 1e-3);
          ASSERT_EQ(one.size(), other.size());
          for (std::size_t i = 0; i < one.size(); ++i) ASSERT_NEAR(one[i], other[i], 1e-12 * most) << i;
        };
        for (std::size_t k = 0; k < alone.velocities.size(); ++k)
          expect_alike(alone.velocities[k], beside.velocities[k]);
        expect_alike(alone.zeroth, beside.zeroth);
        expect_alike(alone.oriented, beside.oriented);
      }
    }
  }
}

TEST(GeodesicShooting, OfNoMomentumStandsStill) {
  MomentumScale<2, double> scale({make_wendland_profile(4), square(9), Orders::ZerothAndFirst, 1.0, 1.0});
  const std::vector<double> m(scale.field_size(), 0.0), first(2 * scale.field_size(), 0.0);
  GeodesicShooting<2, double> shooting({&scale}, scale.lattice(), 2, Evolution::Exact);
  shooting.shoot({{m.data(), first.data()}});
  for (const auto& v : shooting.velocities())
    for (double value : v) ASSERT_EQ(value, 0);
  for (double h : shooting.hamiltonians({{m.data(), first.data()}})) EXPECT_EQ(h, 0);
}

}  // namespace
}  // namespace saltus
