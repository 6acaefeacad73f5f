// Ad* of elements against closed forms: flows whose F and d_n F are known, the sum it says, differences of what its
// adjoint differentiates, and what the geodesics of one kernel conserve.
#include "core/flow/element_transport.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <limits>

#include "core/flow/geodesic_shooting.h"
#include "core/momenta/spread_normals.h"
#include "core/support/errors.h"
#include "tests/support/finite_differences.h"
#include "tests/support/random_fields.h"

namespace saltus {
namespace {

using testing::dot;
using testing::random_values;

template <int Dim>
using Vec = Eigen::Matrix<double, Dim, 1>;
template <int Dim>
using Mat = Eigen::Matrix<double, Dim, Dim>;

/// A smooth flow whose gradient and second derivatives are known.
template <int Dim>
struct Flow {
  static constexpr double kWave = 0.11, kHeight = 2.5;
  static double phase(const Vec<Dim>& x, int c) { return kWave * (x[(c + 1) % Dim] + 0.6 * x[c]) + c; }
  Vec<Dim> operator()(const Vec<Dim>& x) const {
    Vec<Dim> to = x;
    for (int c = 0; c < Dim; ++c) to[c] += kHeight * std::sin(phase(x, c));
    return to;
  }
  static Vec<Dim> direction(int c) { return kWave * (Vec<Dim>::Unit((c + 1) % Dim) + 0.6 * Vec<Dim>::Unit(c)); }
  Mat<Dim> gradient(const Vec<Dim>& x) const {
    Mat<Dim> f = Mat<Dim>::Identity();
    for (int c = 0; c < Dim; ++c) f.row(c) += kHeight * std::cos(phase(x, c)) * direction(c).transpose();
    return f;
  }
  Mat<Dim> gradient_along(const Vec<Dim>& x, const Vec<Dim>& n) const {
    Mat<Dim> f;
    for (int c = 0; c < Dim; ++c)
      f.row(c) = -kHeight * std::sin(phase(x, c)) * direction(c).dot(n) * direction(c).transpose();
    return f;
  }
};

template <int Dim>
OrientedMomenta<Dim, double> momenta_on(double spacing, int apart = 1, double normal_share = 1) {
  OrientedOptions<Dim> options;
  const double extent[3] = {24, 18, 15};
  for (int a = 0; a < Dim; ++a) {
    options.lattice.size[a] = static_cast<int>(extent[a] / spacing) + 1;
    options.lattice.spacing[a] = spacing * (1 + 0.1 * a);
    options.lattice.offset[a] = 0.7 * a;
  }
  options.normals = spread_normals<Dim>(Dim == 2 ? 8 : 13);
  options.width_mm = 6;
  options.weight = 0.7;
  options.spacing = apart;
  options.normal_share = normal_share;
  return OrientedMomenta<Dim, double>(options);
}

template <int Dim>
std::vector<std::uint32_t> some_elements(const OrientedMomenta<Dim, double>& momenta) {
  std::vector<std::uint32_t> elements;
  for (std::size_t e = 3; e < momenta.elements(); e += momenta.elements() / 41)
    elements.push_back(static_cast<std::uint32_t>(e));
  return elements;
}

template <int Dim>
void move(std::vector<double>& points) {
  for (std::size_t i = 0; i < points.size(); i += Dim) {
    Eigen::Map<Vec<Dim>> point(points.data() + i);
    point = Flow<Dim>()(Vec<Dim>(point));
  }
}

template <int Dim>
TransportedElement<Dim, double> expected(const ElementPlacement<Dim, double>& start, const double* values, double sigma,
                                         Evolution evolution) {
  const Flow<Dim> flow;
  const Vec<Dim> x = start.at, n = start.axes.row(0).transpose();
  Vec<Dim> m = Vec<Dim>::Zero();
  for (int j = 1; j < Dim; ++j) m += values[j - 1] * start.axes.row(j).transpose();
  const Mat<Dim> turn = flow.gradient(x).inverse().transpose();
  TransportedElement<Dim, double> to{{flow(x), start.axes}, n, turn * m, Vec<Dim>::Zero()};
  if (evolution == Evolution::PerOrder) return to;
  to.derivative = flow.gradient(x) * n;
  to.zeroth = sigma * turn * flow.gradient_along(x, n).transpose() * turn * m;
  return to;
}

template <int Dim>
double error_against_the_closed_form(double spacing, Evolution evolution) {
  using Oriented = OrientedMomenta<Dim, double>;
  const Oriented momenta = momenta_on<Dim>(spacing);
  const auto elements = some_elements(momenta);
  const std::vector<double> values = random_values((Dim - 1) * elements.size(), 1);
  ElementTransport<Dim, double> transport(momenta, evolution);
  std::vector<double> points, corners;
  transport.place(elements, points);
  EXPECT_EQ(points.size(), elements.size() * transport.kPointValues);
  move<Dim>(points);
  std::vector<TransportedElement<Dim, double>> found;
  transport.transport(points, values.data(), found);
  momenta.place(elements, corners);
  double square = 0;
  for (std::size_t e = 0; e < elements.size(); ++e) {
    const auto start = Oriented::placement(corners.data() + Oriented::kCornerValues * e);
    const auto wanted = expected<Dim>(start, values.data() + (Dim - 1) * e, 6, evolution);
    EXPECT_EQ(found[e].place.axes, start.axes);
    for (const Vec<Dim>& off :
         {Vec<Dim>(found[e].place.at - wanted.place.at), Vec<Dim>(found[e].derivative - wanted.derivative),
          Vec<Dim>(found[e].first - wanted.first), Vec<Dim>(found[e].zeroth - wanted.zeroth)})
      square += off.squaredNorm();
  }
  return std::sqrt(square / static_cast<double>(elements.size()));
}

// Oracle: F and d_n F of a flow in closed form; elements are told by points around them, right to second order.
TEST(ElementTransport, IsTheClosedFormToSecondOrder) {
  const auto check = [](const auto& error) {
    for (Evolution evolution : {Evolution::Exact, Evolution::PerOrder}) {
      const double coarse = error(0.5, evolution), fine = error(0.25, evolution);
      EXPECT_LT(fine, 0.03);
      EXPECT_NEAR(std::log2(coarse / fine), 2, 0.35) << coarse << " " << fine;
    }
  };
  check(error_against_the_closed_form<2>);
  check(error_against_the_closed_form<3>);
}

TEST(ElementTransport, DoesNotCarry) {
  const auto momenta = momenta_on<2>(1);
  EXPECT_THROW((ElementTransport<2, double>(momenta, Evolution::Carried)), InvalidInput);
}

// Oracle: one side of the plane moves along it and turns, the other rests. What an element is told of F is the mean of
// both, whatever the jump between them.
TEST(ElementTransport, DoesNotDifferentiateAcrossTheElement) {
  const auto momenta = momenta_on<2>(1);
  const std::vector<std::uint32_t> elements = {static_cast<std::uint32_t>(momenta.lattice().sites() + 60)};
  const double value = 1;
  std::vector<double> corners, points;
  momenta.place(elements, corners);
  const auto start = OrientedMomenta<2, double>::placement(corners.data());
  const Vec<2> n = start.axes.row(0).transpose(), t = start.axes.row(1).transpose(), x = start.at;
  for (const double jump : {0.0, 7.0}) {
    ElementTransport<2, double> transport(momenta, Evolution::Exact);
    transport.place(elements, points);
    const Mat<2> turned = Mat<2>::Identity() + 0.2 * t * t.transpose() - 0.1 * n * n.transpose();
    for (std::size_t i = 0; i < points.size(); i += 2) {
      Eigen::Map<Vec<2>> point(points.data() + i);
      if ((point - x).dot(n) > 0) point = x + turned * (point - x) + jump * t;
    }
    std::vector<TransportedElement<2, double>> found;
    transport.transport(points, &value, found);
    const Mat<2> F = (turned + Mat<2>::Identity()) / 2;
    EXPECT_NEAR((found[0].derivative - F * n).norm(), 0, 1e-12);
    EXPECT_NEAR((found[0].first - t / (t.dot(F * t))).norm(), 0, 1e-12);
    // d_n F: what both sides say along t, a cell apart, and along n, two cells apart.
    const Mat<2> along = 0.2 * t * t.transpose() - 0.05 * n * n.transpose(), turn = F.inverse().transpose();
    EXPECT_NEAR(
        (found[0].zeroth - 6 * turn * along.transpose() * turn * t / cell_along<2>(momenta.lattice(), n)).norm(), 0,
        1e-11);
  }
}

/// Transported elements as anything might leave them: not too far from where they were.
template <int Dim>
struct Anywhere {
  static constexpr std::size_t kIdle = 5;  ///< an element without momentum
  OrientedMomenta<Dim, double> momenta;
  std::vector<std::uint32_t> elements = some_elements(momenta);
  std::vector<double> values = random_values((Dim - 1) * elements.size(), 2), points;
  ElementTransport<Dim, double> transport{momenta, Evolution::Exact};
  std::vector<TransportedElement<Dim, double>> transported;

  explicit Anywhere(double normal_share) : momenta(momenta_on<Dim>(1, Dim == 3 ? 2 : 1, normal_share)) {
    for (std::size_t j = 0; j + 1 < Dim; ++j) values[(Dim - 1) * kIdle + j] = 0;
    if (Dim == 3) values[(Dim - 1) * (kIdle + 1)] = 0;  // along one axis of its plane alone
    transport.place(elements, points);
    move<Dim>(points);
    transport.transport(points, values.data(), transported);
  }
  std::vector<double> made(const std::vector<TransportedElement<Dim, double>>& by) const {
    std::vector<double> velocity(Dim * momenta.lattice().sites(), 0.0);
    momenta.add_transported(elements, by, values.data(), velocity.data());
    return velocity;
  }
};

// At time 0 they are what OrientedMomenta says, and so is their energy.
template <int Dim>
void expect_elements_at_rest(double normal_share) {
  Anywhere<Dim> scene(normal_share);
  std::vector<double> corners, wanted(Dim * scene.momenta.lattice().sites(), 0.0);
  scene.momenta.place(scene.elements, corners);
  scene.momenta.add_velocity(scene.elements, corners.data(), scene.values.data(), wanted.data());
  scene.transport.place(scene.elements, scene.points);
  scene.transport.transport(scene.points, scene.values.data(), scene.transported);
  const std::vector<double> made = scene.made(scene.transported);
  double most = 0, worst = 0;
  for (std::size_t i = 0; i < made.size(); ++i) {
    most = std::max(most, std::abs(wanted[i]));
    worst = std::max(worst, std::abs(wanted[i] - made[i]));
  }
  EXPECT_GT(most, 1e-3);
  EXPECT_LT(worst, 1e-12 * most);
  std::vector<double> gradient(scene.values.size(), 0.0);
  const double penalty = scene.momenta.penalty(scene.elements, scene.values.data(), gradient.data());
  EXPECT_NEAR(scene.momenta.energy(scene.elements, scene.transported), penalty, 1e-12 * penalty);
}

TEST(ElementTransport, LeavesElementsAtRestAsTheyAre) {
  for (double normal_share : {1.0, 0.5}) {
    expect_elements_at_rest<2>(normal_share);
    expect_elements_at_rest<3>(normal_share);
  }
}

// Oracle: the sum in oriented_momenta.h with derivatives by differences of the product of averaged values.
template <int Dim>
void expect_the_written_sum(double normal_share) {
  const Anywhere<Dim> scene(normal_share);
  const Lattice<Dim>& lattice = scene.momenta.lattice();
  Lattice<Dim> apart = lattice;
  const Index<Dim> steps = sites_apart(lattice, 6.0, scene.momenta.options().spacing);
  for (int a = 0; a < Dim; ++a) apart.spacing[a] *= steps[a];
  std::vector<double> wanted(Dim * lattice.sites(), 0.0);
  for (std::size_t e = 0; e < scene.elements.size(); ++e) {
    if (e == scene.kIdle) continue;
    const auto& one = scene.transported[e];
    const auto product = [&](const Vec<Dim>& r) {
      double value = 1;
      for (int k = 0; k < Dim; ++k) {
        const Vec<Dim> axis = one.place.axes.row(k).transpose();
        const double width = k == 0 ? 6 * normal_share : 6;
        value *= AveragedWendland<double>(width, cell_along<Dim>(k == 0 ? lattice : apart, axis)).value(axis.dot(r));
      }
      return value;
    };
    for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab)
      visit_slab<Dim>(lattice, slab, [&](const Index<Dim>& index, std::size_t site) {
        Vec<Dim> r;
        for (int a = 0; a < Dim; ++a) r[a] = lattice.offset[a] + index[a] * lattice.spacing[a] - one.place.at[a];
        constexpr double step = 1e-5;
        const double derived = (product(r + step * one.derivative) - product(r - step * one.derivative)) / (2 * step);
        Eigen::Map<Vec<Dim>>(wanted.data() + Dim * site) +=
            0.7 * lattice.cell_volume() * (product(r) * one.zeroth + 6 * normal_share * derived * one.first);
      });
  }
  const std::vector<double> made = scene.made(scene.transported);
  double most = 0;
  for (double v : wanted) most = std::max(most, std::abs(v));
  for (std::size_t i = 0; i < made.size(); ++i) ASSERT_NEAR(made[i], wanted[i], 1e-5 * most) << i;
}

TEST(ElementTransport, MakesTheVelocityThatIsWritten) {
  for (double normal_share : {1.0, 0.5}) {
    expect_the_written_sum<2>(normal_share);
    expect_the_written_sum<3>(normal_share);
  }
}

template <int Dim>
void expect_exact_adjoints(double normal_share) {
  Anywhere<Dim> scene(normal_share);
  const std::vector<double> dual = random_values(Dim * scene.momenta.lattice().sites(), 3);
  // Of the velocity: every member of every element.
  std::vector<TransportedElement<Dim, double>> duals(scene.elements.size());
  scene.momenta.add_transported_adjoint(scene.elements, scene.transported, scene.values.data(), dual.data(), true,
                                        duals);
  std::vector<double> along = random_values(4 * Dim * scene.elements.size(), 4);
  double slope = 0;
  const auto stepped = [&](double step) {
    auto by = scene.transported;
    for (std::size_t e = 0; e < by.size(); ++e) {
      const auto part = [&](int i) { return Eigen::Map<const Vec<Dim>>(along.data() + Dim * (4 * e + i)); };
      by[e].place.at += step * part(0);
      by[e].derivative += step * part(1);
      by[e].first += step * part(2);
      by[e].zeroth += step * part(3);
    }
    return dot(scene.made(by), dual);
  };
  for (std::size_t e = 0; e < duals.size(); ++e) {
    const auto part = [&](int i) { return Eigen::Map<const Vec<Dim>>(along.data() + Dim * (4 * e + i)); };
    if (e == scene.kIdle) continue;  // makes nothing, whatever it would be
    slope += duals[e].place.at.dot(part(0)) + duals[e].derivative.dot(part(1)) + duals[e].first.dot(part(2)) +
             duals[e].zeroth.dot(part(3));
  }
  EXPECT_NEAR(slope, (stepped(1e-5) - stepped(-1e-5)) / 2e-5, 1e-6 * std::abs(slope));

  // What pulls at an idle element, by which it joins, is what would pull at an active one; idle ones do not move.
  std::vector<TransportedElement<Dim, double>> active(duals.size()), unmoved(duals.size());
  std::vector<double> values = scene.values;
  values[(Dim - 1) * scene.kIdle] = 1;
  scene.momenta.add_transported_adjoint(scene.elements, scene.transported, values.data(), dual.data(), true, active);
  scene.momenta.add_transported_adjoint(scene.elements, scene.transported, values.data(), dual.data(), false, unmoved);
  for (std::size_t e = 0; e < duals.size(); ++e) {
    EXPECT_GT(duals[e].first.norm() * duals[e].zeroth.norm(), 0);
    for (const auto& other : {active[e], unmoved[e]}) {
      EXPECT_NEAR((duals[e].first - other.first).norm(), 0, 1e-13 * other.first.norm());
      EXPECT_NEAR((duals[e].zeroth - other.zeroth).norm(), 0, 1e-13 * other.zeroth.norm());
    }
    EXPECT_EQ(unmoved[e].place.at.norm() + unmoved[e].derivative.norm(), 0);
    EXPECT_EQ(duals[e].place.at.norm() + duals[e].derivative.norm() > 0, e != scene.kIdle);
  }

  // Of the transport: points and momenta.
  const std::vector<double> weights = random_values(4 * Dim * scene.elements.size(), 5);
  std::vector<TransportedElement<Dim, double>> told(scene.elements.size());
  for (std::size_t e = 0; e < told.size(); ++e) {
    const auto part = [&](int i) { return Eigen::Map<const Vec<Dim>>(weights.data() + Dim * (4 * e + i)); };
    told[e].place.at = part(0);
    told[e].derivative = part(1);
    told[e].first = part(2);
    told[e].zeroth = part(3);
  }
  for (Evolution evolution : {Evolution::Exact, Evolution::PerOrder}) {
    ElementTransport<Dim, double> transport(scene.momenta, evolution);
    std::vector<double> points;
    transport.place(scene.elements, points);
    points = scene.points;
    const std::size_t split = points.size();
    std::vector<double> both = points, gradient(split + scene.values.size(), 0.0);
    both.insert(both.end(), scene.values.begin(), scene.values.end());
    transport.adjoint(points, scene.values.data(), told, gradient.data() + split, gradient.data());
    const std::vector<double> direction = random_values(both.size(), 6);
    const double by_differences = testing::slope_along(
        [&](const std::vector<double>& at) {
          std::vector<TransportedElement<Dim, double>> found;
          transport.transport({at.begin(), at.begin() + static_cast<std::ptrdiff_t>(split)}, at.data() + split, found);
          double sum = 0;
          for (std::size_t e = 0; e < found.size(); ++e)
            sum += found[e].place.at.dot(told[e].place.at) + found[e].derivative.dot(told[e].derivative) +
                   found[e].first.dot(told[e].first) + found[e].zeroth.dot(told[e].zeroth);
          return sum;
        },
        both, direction);
    EXPECT_NEAR(dot(gradient, direction), by_differences,
                1e-7 * std::sqrt(dot(gradient, gradient) * dot(direction, direction)));
    std::vector<double> values_alone(scene.values.size(), 0.0);
    transport.adjoint(points, scene.values.data(), told, values_alone.data(), nullptr);
    EXPECT_TRUE(
        std::equal(values_alone.begin(), values_alone.end(), gradient.begin() + static_cast<std::ptrdiff_t>(split)));
  }
}

TEST(ElementTransport, HasExactAdjoints) {
  for (double normal_share : {1.0, 0.5}) {
    expect_exact_adjoints<2>(normal_share);
    expect_exact_adjoints<3>(normal_share);
  }
}

/// How far the energy of elements drifts along their flow, as a share of it. `momentum(r, normal)` is theirs at r from
/// the middle, 0 where there are none.
template <class Momentum>
double drift(double spacing, int steps, Evolution evolution, const std::vector<double>& angles, double normal_share,
             Momentum&& momentum) {
  const int n = static_cast<int>(96 / spacing);
  const Lattice<2> lattice{{n, n}, {spacing, spacing}, {}};
  MomentumScaleOptions<2> options{make_wendland_profile(16), lattice, Orders::ZerothAndFirst, 1.0, 0.7};
  for (double angle : angles) options.normals.emplace_back(std::cos(angle), std::sin(angle));
  options.oriented_normal_share = normal_share;
  MomentumScale<2, double> scale(options);
  std::vector<std::uint32_t> elements;
  std::vector<double> values;
  for (std::size_t normal = 0; normal < angles.size(); ++normal)
    for (std::size_t site = 0; site < lattice.sites(); ++site) {
      const Vec<2> r = Vec<2>(static_cast<double>(site % static_cast<std::size_t>(n)),
                              static_cast<double>(site / static_cast<std::size_t>(n))) *
                           spacing -
                       Vec<2>(48, 48);
      const double m = momentum(r, normal);
      if (m == 0) continue;
      elements.push_back(static_cast<std::uint32_t>(normal * lattice.sites() + site));
      values.push_back(m);
    }
  const std::vector<double> none(3 * scale.field_size(), 0.0);
  const MomentumPointers<double> momenta{none.data(), none.data() + scale.field_size(), &elements, values.data()};
  GeodesicShooting<2, double> shooting({&scale}, lattice, steps, evolution);
  shooting.shoot({momenta});
  const std::vector<double> energies = shooting.hamiltonians({momenta});
  EXPECT_GT(energies[0], 0);
  return (energies.back() - energies[0]) / energies[0];
}

/// Two smooth blobs of momentum along an oblique plane that pass each other; and across, if there are two normals, one.
double drift_of_blobs(double spacing, int steps, Evolution evolution, std::size_t normals = 1,
                      double normal_share = 1) {
  const std::vector<double> angles = {0.5, 1.6};
  return drift(spacing, steps, evolution, {angles.begin(), angles.begin() + static_cast<std::ptrdiff_t>(normals)},
               normal_share, [](const Vec<2>& r, std::size_t normal) {
                 const auto blob = [&](double x, double y) { return std::exp(-(r - Vec<2>(x, y)).squaredNorm() / 40); };
                 const double m = normal == 0 ? blob(-4, 4) - 0.8 * blob(5, -5) : 0.9 * blob(3, 4);
                 return std::abs(m) < 0.01 ? 0 : 4 * m;
               });
}

// Oracle: geodesics of one kernel conserve their Hamiltonian. What is left falls with the spacing; leaving out a term
// (as `per_order` does on purpose) does not, nor do two kernels, where there is no Hamiltonian.
TEST(ElementTransport, ConservesTheEnergyOfOneKernel) {
  const double coarse = drift_of_blobs(1, 8, Evolution::Exact), fine = drift_of_blobs(0.5, 8, Evolution::Exact);
  EXPECT_LT(std::abs(fine), 0.002);
  EXPECT_LT(std::abs(fine), 0.4 * std::abs(coarse)) << coarse;
  EXPECT_GT(std::abs(drift_of_blobs(1, 8, Evolution::PerOrder)), 40 * std::abs(coarse)) << coarse;
  EXPECT_GT(std::abs(drift_of_blobs(1, 8, Evolution::Exact, 2)), 5 * std::abs(coarse)) << coarse;
}

// The same of a kernel that is half as wide along the normal.
TEST(ElementTransport, ConservesTheEnergyOfANarrowKernel) {
  const double coarse = drift_of_blobs(1, 8, Evolution::Exact, 1, 0.5),
               fine = drift_of_blobs(0.5, 8, Evolution::Exact, 1, 0.5);
  EXPECT_LT(std::abs(fine), 0.004);
  EXPECT_LT(std::abs(fine), 0.4 * std::abs(coarse)) << coarse;
}

// As above: second order in the time step.
TEST(ElementTransport, ConservesEnergyToSecondOrderInTheTimeStep) {
  const double limit = drift_of_blobs(1.5, 24, Evolution::Exact);
  const double at2 = std::abs(drift_of_blobs(1.5, 2, Evolution::Exact) - limit),
               at4 = std::abs(drift_of_blobs(1.5, 4, Evolution::Exact) - limit);
  EXPECT_GT(at2, 0.002) << "too gentle to show an order";
  EXPECT_NEAR(std::log2(at2 / at4), 2, 0.6) << at2 << " then " << at4;
}

// A sheet a cell thick is what no lattice resolves: its energy is kept as long as it moves by little.
TEST(ElementTransport, ConservesTheEnergyOfASheetThatMovesLittle) {
  const auto drift_of_sheet = [](double spacing, double amount) {
    const Vec<2> n(std::cos(0.5), std::sin(0.5));
    return std::abs(drift(spacing, 8, Evolution::Exact, {0.5}, 1, [&](const Vec<2>& r, std::size_t) {
      const double along = r.squaredNorm() - std::pow(r.dot(n), 2);
      return std::abs(r.dot(n)) <= spacing / 2 * n[0] && along < 400 ? amount / spacing * std::exp(-along / 80) : 0;
    }));
  };
  for (double spacing : {2.0, 1.0}) EXPECT_LT(drift_of_sheet(spacing, 4), 0.01) << spacing;  // a jump of 0.6
}

// No energy is known of elements that are carried as things.
TEST(ElementTransport, TellsNoEnergyOfWhatIsCarried) {
  EXPECT_THROW(drift_of_blobs(2, 1, Evolution::Carried), InvalidInput);
}

}  // namespace
}  // namespace saltus
