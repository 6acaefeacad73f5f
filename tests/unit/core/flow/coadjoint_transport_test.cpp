#include "core/flow/coadjoint_transport.h"

#include <gtest/gtest.h>
#include <omp.h>

#include <Eigen/LU>
#include <cmath>
#include <ostream>

#include "tests/support/finite_differences.h"
#include "tests/support/many_threads.h"
#include "tests/support/random_fields.h"

namespace saltus {
namespace {

using testing::dot;
using testing::random_values;

struct Case {
  Evolution evolution;
  bool has_zeroth, has_first;
};

std::string name_of(const Case& how) {
  const char* evolution = how.evolution == Evolution::Exact      ? "Exact"
                          : how.evolution == Evolution::PerOrder ? "PerOrder"
                                                                 : "Carried";
  return std::string(evolution) + (how.has_zeroth ? "_Zeroth" : "") + (how.has_first ? "_First" : "");
}
void PrintTo(const Case& how, std::ostream* out) { *out << name_of(how); }

template <int Dim>
Lattice<Dim> lattice() {
  if constexpr (Dim == 2)
    return {{9, 8}, {1, 1.4}, {}};
  else
    return {{6, 5, 7}, {1, 1.4, 0.8}, {}};
}

template <int Dim>
struct Pushed {
  std::vector<double> zeroth, first;
};

template <int Dim>
class Transport {
 public:
  explicit Transport(const Case& how)
      : how_(how),
        where(lattice<Dim>()),
        field(Dim * where.sites()),
        sites(where, how.evolution),
        transport(where, 2.3, how.has_zeroth, how.has_first, how.evolution) {}

  Pushed<Dim> push(const std::vector<double>& displacement, const std::vector<double>& zeroth,
                   const std::vector<double>& first) {
    Pushed<Dim> out{std::vector<double>(field, 1e300), std::vector<double>(how_.has_first ? Dim * field : 0, 1e300)};
    sites.move(displacement.data());
    transport.push(sites, how_.has_zeroth ? zeroth.data() : nullptr, how_.has_first ? first.data() : nullptr, {},
                   transport.reached(sites, {}), out.zeroth.data(), how_.has_first ? out.first.data() : nullptr);
    // What it cannot reach it leaves alone, and that is 0.
    if (transport.reached(sites, {}).zeroth.is_empty()) std::fill(out.zeroth.begin(), out.zeroth.end(), 0.0);
    return out;
  }

 private:
  Case how_;

 public:
  Lattice<Dim> where;
  std::size_t field;
  MovedSites<Dim, double> sites;
  CoadjointTransport<Dim, double> transport;
};

class CoadjointTransportTest : public ::testing::TestWithParam<Case> {};

// Oracle: central differences along directions in each argument alone.
template <int Dim>
void expect_adjoint(const Case& how) {
  Transport<Dim> t(how);
  const std::size_t field = t.field, firsts = how.has_first ? Dim * field : 0;
  const std::vector<double> d = random_values(field, 1, 0.15), m0 = random_values(field, 2),
                            m1 = random_values(firsts, 3), w0 = random_values(field, 4), w1 = random_values(firsts, 5);
  const auto pairing = [&](const std::vector<double>& d, const std::vector<double>& m0, const std::vector<double>& m1) {
    const Pushed<Dim> out = t.push(d, m0, m1);
    return dot(out.zeroth, w0) + dot(out.first, w1);
  };
  std::vector<double> d_dual(field, 1.0), m0_dual(field, 2.0), m1_dual(firsts, 3.0);
  const auto all = BlockMask<Dim>::all(t.where);
  t.sites.move(d.data());
  t.sites.begin_adjoint(all);
  t.transport.push_adjoint(t.sites, how.has_zeroth ? m0.data() : nullptr, how.has_first ? m1.data() : nullptr, {},
                           w0.data(), w1.data(), d_dual.data(), how.has_zeroth ? m0_dual.data() : nullptr,
                           how.has_first ? m1_dual.data() : nullptr);
  t.sites.end_adjoint(all, d_dual.data());
  // It adds to what is there.
  for (double& v : d_dual) v -= 1;
  for (double& v : m0_dual) v -= 2;
  for (double& v : m1_dual) v -= 3;
  const double scale = std::sqrt(field * dot(w0, w0) + firsts * dot(w1, w1));
  for (std::uint64_t seed : {11, 12, 13}) {
    const std::vector<double> along = random_values(field, seed);
    const double slope = testing::slope_along([&](const auto& at) { return pairing(at, m0, m1); }, d, along, 1e-7);
    EXPECT_NEAR(dot(d_dual, along), slope, 1e-6 * scale) << "displacement";
    EXPECT_GT(std::abs(slope), 1e-3) << "nothing tested";
  }
  if (how.has_zeroth) {
    EXPECT_NEAR(dot(m0_dual, m0) + dot(m1_dual, m1), pairing(d, m0, m1), 1e-11 * scale);
  }
  const std::vector<double> along0 = random_values(field, 21), along1 = random_values(firsts, 22);
  if (how.has_zeroth) {
    EXPECT_NEAR(dot(m0_dual, along0), pairing(d, along0, std::vector<double>(firsts, 0.0)), 1e-11 * scale);
  }
  if (how.has_first) {
    EXPECT_NEAR(dot(m1_dual, along1), pairing(d, std::vector<double>(field, 0.0), along1), 1e-11 * scale);
  }
}

TEST_P(CoadjointTransportTest, HasAnExactAdjoint) {
  expect_adjoint<2>(GetParam());
  expect_adjoint<3>(GetParam());
}

template <int Dim>
void expect_identity(const Case& how) {
  Transport<Dim> t(how);
  const std::vector<double> none(t.field, 0.0), m0 = random_values(t.field, 2), m1 = random_values(Dim * t.field, 3);
  const Pushed<Dim> out = t.push(none, m0, m1);
  for (std::size_t i = 0; i < t.field; ++i) ASSERT_NEAR(out.zeroth[i], how.has_zeroth ? m0[i] : 0.0, 1e-14);
  for (std::size_t i = 0; i < out.first.size(); ++i) ASSERT_NEAR(out.first[i], m1[i], 1e-14);
}

TEST_P(CoadjointTransportTest, LeavesMomentaWhereNothingMoves) {
  expect_identity<2>(GetParam());
  expect_identity<3>(GetParam());
}

// Oracle: whole samples of translation shift the arrays.
TEST_P(CoadjointTransportTest, ShiftsMomentaWithATranslation) {
  const Case how = GetParam();
  Transport<2> t(how);
  std::vector<double> d(t.field), m0(t.field, 0.0), m1(2 * t.field, 0.0);
  for (std::size_t i = 0; i < t.where.sites(); ++i) d[2 * i] = 2 * 1.0, d[2 * i + 1] = -1 * 1.4;
  const auto site = [](int x, int y) { return static_cast<std::size_t>(9 * y + x); };
  for (int c : {0, 1}) {
    m0[2 * site(3, 4) + c] = 1.5 - c;
    m1[2 * site(2, 5) + c] = 0.5 + c;
    m1[t.field + 2 * site(4, 2) + c] = -0.7;
  }
  const Pushed<2> out = t.push(d, m0, m1);
  double total = 0;
  for (double v : out.zeroth) total += std::abs(v);
  EXPECT_NEAR(total, how.has_zeroth ? 2.0 : 0.0, 1e-12);
  for (int c : {0, 1}) {
    if (how.has_zeroth) {
      EXPECT_NEAR(out.zeroth[2 * site(5, 3) + c], 1.5 - c, 1e-12);
    }
    if (!how.has_first) continue;
    EXPECT_NEAR(out.first[2 * site(4, 4) + c], 0.5 + c, 1e-12);
    EXPECT_NEAR(out.first[t.field + 2 * site(6, 1) + c], -0.7, 1e-12);
  }
}

// Oracle: conservation. Carried vectors are only spread, by weights that sum to 1, even over the border.
template <int Dim>
void expect_totals_kept() {
  const Case how{Evolution::Carried, true, true};
  Transport<Dim> t(how);
  const std::vector<double> d = random_values(t.field, 1, 3.0), m0 = random_values(t.field, 2),
                            m1 = random_values(Dim * t.field, 3);
  const Pushed<Dim> out = t.push(d, m0, m1);
  for (int c = 0; c < Dim; ++c) {
    double before = 0, after = 0;
    for (std::size_t i = static_cast<std::size_t>(c); i < t.field; i += Dim) before += m0[i], after += out.zeroth[i];
    EXPECT_NEAR(after, before, 1e-11);
    before = after = 0;
    for (std::size_t i = static_cast<std::size_t>(c); i < Dim * t.field; i += Dim)
      before += m1[i], after += out.first[i];
    EXPECT_NEAR(after, before, 1e-11);
  }
}

TEST(CoadjointTransportCarried, ConservesTheTotalMomentumOfEachOrder) {
  expect_totals_kept<2>();
  expect_totals_kept<3>();
}

// Oracle: the definition of Ad*. The pushed element acts on a field w as the first one does on w pulled back,
// (D phi)^-1 w o phi, both pairings by quadrature of smooth functions with a known map.
TEST(CoadjointTransportExact, IsTheDualOfPullingFieldsBack) {
  const Lattice<2> where{{161, 161}, {0.25, 0.25}, {}};
  const double unit = 2.3, cell = where.cell_volume();
  const auto bump = [](double x, double y) { return std::exp(-((x - 19) * (x - 19) + (y - 21) * (y - 21)) / 16); };
  // phi(x) = x + d(x), smooth, with a Jacobian far from the identity.
  const auto displacement = [](double x, double y) {
    return Vector<2>(1.6 * std::sin(0.21 * y + 0.1 * x), 1.3 * std::cos(0.17 * x - 0.12 * y));
  };
  const auto jacobian = [](double x, double y) {
    Matrix<2> F;
    F << 1 + 0.16 * std::cos(0.21 * y + 0.1 * x), 0.336 * std::cos(0.21 * y + 0.1 * x),
        -0.221 * std::sin(0.17 * x - 0.12 * y), 1 + 0.156 * std::sin(0.17 * x - 0.12 * y);
    return F;
  };
  const auto w = [](const Vector<2>& x) {
    return Vector<2>(std::sin(0.3 * x[0] + 0.2 * x[1]), std::cos(0.25 * x[1] - 0.1 * x[0]));
  };
  const auto pulled = [&](double x, double y) -> Vector<2> {
    return jacobian(x, y).inverse() * w(Vector<2>(x, y) + displacement(x, y));
  };
  const Vector<2> direction(0.8, -1.1);
  for (int order : {-1, 0, 1}) {
    SCOPED_TRACE(order);
    const std::size_t field = 2 * where.sites();
    std::vector<double> d(field), m0(field, 0.0), m1(2 * field, 0.0), out0(field), out1(2 * field);
    double expected = 0;
    for (int slab = 0; slab < where.size[1]; ++slab)
      visit_slab<2>(where, slab, [&](const Index<2>& i, std::size_t site) {
        const double x = 0.25 * i[0], y = 0.25 * i[1];
        const Vector<2> moved = displacement(x, y);
        const double fx = order == 0 ? x + 0.125 : x, fy = order == 1 ? y + 0.125 : y;
        for (int c : {0, 1}) {
          d[2 * site + c] = moved[c];
          (order < 0 ? m0[2 * site + c] : m1[field * order + 2 * site + c]) = direction[c] * bump(fx, fy);
        }
        if (order < 0) {
          expected += bump(x, y) * direction.dot(pulled(x, y));
        } else {
          const double e = 1e-4;
          const Vector<2> slope = order == 0 ? Vector<2>((pulled(fx + e, fy) - pulled(fx - e, fy)) / (2 * e))
                                             : Vector<2>((pulled(fx, fy + e) - pulled(fx, fy - e)) / (2 * e));
          expected -= unit * bump(fx, fy) * direction.dot(slope);
        }
      });
    CoadjointTransport<2, double> transport(where, unit, true, true, Evolution::Exact);
    MovedSites<2, double> sites(where, Evolution::Exact);
    sites.move(d.data());
    transport.push(sites, m0.data(), m1.data(), {}, transport.reached(sites, {}), out0.data(), out1.data());
    double found = 0;
    for (int slab = 0; slab < where.size[1]; ++slab)
      visit_slab<2>(where, slab, [&](const Index<2>& i, std::size_t site) {
        const double x = 0.25 * i[0], y = 0.25 * i[1], h = 0.125;
        const Vector<2> here = w({x, y}), dx = (w({x + 2 * h, y}) - w({x, y})) / (2 * h),
                        dy = (w({x, y + 2 * h}) - w({x, y})) / (2 * h);
        for (int c : {0, 1})
          found +=
              out0[2 * site + c] * here[c] - unit * (out1[2 * site + c] * dx[c] + out1[field + 2 * site + c] * dy[c]);
      });
    EXPECT_NEAR(found * cell, expected * cell, 2e-3 * 16 * 3.14) << "of " << expected * cell;
  }
}

std::vector<Case> all_cases() {
  std::vector<Case> cases;
  for (Evolution evolution : {Evolution::Exact, Evolution::PerOrder, Evolution::Carried})
    for (const auto& [zeroth, first] : {std::pair{true, false}, {false, true}, {true, true}})
      cases.push_back({evolution, zeroth, first});
  return cases;
}

INSTANTIATE_TEST_SUITE_P(Evolutions, CoadjointTransportTest, ::testing::ValuesIn(all_cases()),
                         [](const auto& info) { return name_of(info.param); });

// Faces add to planes beside theirs. Oracle: the same sums by one thread.
// Duals that other faces add to must come in one order. They start from values, without which two terms would commute.
TEST(CoadjointTransport, GivesTheSameBitsForAnyNumberOfThreads) {
  const Lattice<3> where = {{7, 6, 23}, {1, 1.1, 1.3}, {}};
  const std::size_t field = 3 * where.sites();
  const std::vector<double> d = random_values(field, 1, 0.3), m0 = random_values(field, 2),
                            m1 = random_values(3 * field, 3), w0 = random_values(field, 4),
                            w1 = random_values(3 * field, 5), start = random_values(9 * field, 6);
  const testing::ManyThreads many;
  for (Evolution evolution : {Evolution::Exact, Evolution::PerOrder, Evolution::Carried}) {
    SCOPED_TRACE(name_of({evolution, true, true}));
    std::vector<std::vector<double>> results;
    for (int threads : {1, 2, 5, 2, 5, 2, 5}) {
      omp_set_num_threads(threads);
      CoadjointTransport<3, double> transport(where, 2.3, true, true, evolution);
      std::vector<double> all = start;
      double *pushed = all.data(), *duals = pushed + 4 * field;
      MovedSites<3, double> sites(where, evolution);
      sites.move(d.data());
      transport.push(sites, m0.data(), m1.data(), {}, transport.reached(sites, {}), pushed, pushed + field);
      sites.begin_adjoint(BlockMask<3>::all(where));
      transport.push_adjoint(sites, m0.data(), m1.data(), {}, w0.data(), w1.data(), duals, duals + field,
                             duals + 2 * field);
      sites.end_adjoint(BlockMask<3>::all(where), duals);
      results.push_back(std::move(all));
    }
    for (std::size_t k = 1; k < results.size(); ++k) EXPECT_TRUE(results[k] == results[0]) << k;
  }
}

}  // namespace
}  // namespace saltus
