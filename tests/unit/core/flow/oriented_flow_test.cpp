// Elements of oriented momenta carried by a flow, against their particle paths: each by itself to where the exact flow
// takes its middle, with the normal F^-T n and first axis F t_1 (made unit), F exact as well. What both differ by is
// all that is approximated: time steps, velocities linear between samples, and a simplex of two cells in place of a
// point.
#include "core/flow/oriented_flow.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <functional>

#include "core/grid/image_grid.h"
#include "core/momenta/spread_normals.h"

namespace saltus {
namespace {

/// A vortex about the middle that turns by angle(r) in unit time (in 3-D with a shear along its axis), in closed form.
template <int Dim>
struct Vortex {
  Vector<Dim> middle;
  double turn = 0.9, radius = 14;

  double angle(double r) const { return turn * std::exp(-r * r / (radius * radius)); }
  Vector<Dim> velocity(const Vector<Dim>& x) const {
    const Vector<Dim> from = x - middle;
    const double rate = angle(from.template head<2>().norm());
    Vector<Dim> v = Vector<Dim>::Zero();
    v[0] = -rate * from[1];
    v[1] = rate * from[0];
    if constexpr (Dim == 3) v[2] = 6 * rate;
    return v;
  }
  Vector<Dim> flow(const Vector<Dim>& x) const {
    const Vector<Dim> from = x - middle;
    const double rate = angle(from.template head<2>().norm()), c = std::cos(rate), s = std::sin(rate);
    Vector<Dim> to = x;
    to[0] = middle[0] + c * from[0] - s * from[1];
    to[1] = middle[1] + s * from[0] + c * from[1];
    if constexpr (Dim == 3) to[2] += 6 * rate;
    return to;
  }
  Matrix<Dim> gradient(const Vector<Dim>& x) const {
    constexpr double step = 1e-5;
    Matrix<Dim> f;
    for (int a = 0; a < Dim; ++a)
      f.col(a) = (flow(x + step * Vector<Dim>::Unit(a)) - flow(x - step * Vector<Dim>::Unit(a))) / (2 * step);
    return f;
  }
};

enum class Plane { Turns, KeepsItsNormal };

/// One experiment: a few elements far from each other, so that each of them is seen.
template <int Dim>
class Experiment {
 public:
  using Oriented = OrientedMomenta<Dim, double>;
  using Element = typename Oriented::Element;

  explicit Experiment(double spacing = 1) {
    const double extent = Dim == 2 ? 60 : 36;
    lattice_.size.fill(static_cast<int>(extent / spacing) + 1);
    lattice_.spacing.fill(spacing);
    vortex_.middle.setConstant(extent / 2);
    if (Dim == 3) vortex_.radius = 10;
    OrientedOptions<Dim> options;
    options.lattice = lattice_;
    options.normals = spread_normals<Dim>(Dim == 2 ? 8 : 13);
    options.width_mm = 6;
    momenta_ = std::make_unique<Oriented>(options);
    for (std::size_t normal = 0; normal < options.normals.size(); normal += 2) {
      // On a ring in the steepest part of the vortex.
      const double turn =
          2 * std::numbers::pi * static_cast<double>(normal) / static_cast<double>(options.normals.size());
      Index<Dim> index;
      index.fill(static_cast<int>(std::lround(extent / 2 / spacing)));
      index[0] += static_cast<int>(std::lround(0.6 * vortex_.radius * std::cos(turn) / spacing));
      index[1] += static_cast<int>(std::lround(0.6 * vortex_.radius * std::sin(turn) / spacing));
      std::size_t site = 0;
      for (int a = Dim - 1; a >= 0; --a)
        site = site * static_cast<std::size_t>(lattice_.size[a]) + static_cast<std::size_t>(index[a]);
      elements_.push_back(static_cast<Element>(normal * lattice_.sites() + site));
      for (int j = 1; j < Dim; ++j) values_.push_back(1 + 0.3 * j);
    }
    velocity_.resize(Dim * lattice_.sites());
    for (int slab = 0; slab < lattice_.size[Dim - 1]; ++slab)
      visit_slab<Dim>(lattice_, slab, [&](const Index<Dim>& at, std::size_t site) {
        Vector<Dim> x;
        for (int a = 0; a < Dim; ++a) x[a] = at[a] * spacing;
        const Vector<Dim> v = vortex_.velocity(x);
        for (int c = 0; c < Dim; ++c) velocity_[Dim * site + c] = v[c];
      });
  }

  /// What the elements make at the end, carried in so many steps.
  std::vector<double> carried(int steps) const {
    OrientedFlow<Dim, double> flow(*momenta_, lattice_, steps, Evolution::Carried);
    const double dt = 1.0 / steps;
    flow.begin(&elements_, values_.data());
    for (int k = 0; k < steps; ++k) {
      flow.predict(k, velocity_.data(), dt);
      if (k + 1 < steps) flow.correct(k + 1, velocity_.data(), dt);
    }
    std::vector<double> made(velocity_.size(), 0.0);
    flow.add_velocity(steps, made.data());
    return made;
  }

  /// The same of particles.
  std::vector<double> exact(Plane plane) const {
    std::vector<double> start, corners;
    momenta_->place(elements_, start);
    corners.resize(start.size());
    for (std::size_t e = 0; e < elements_.size(); ++e) {
      const auto place = Oriented::placement(start.data() + Oriented::kCornerValues * e);
      const Vector<Dim> at = place.at;
      Matrix<Dim> axes = place.axes;
      if (plane == Plane::Turns) {
        const Matrix<Dim> f = vortex_.gradient(at);
        axes.row(0) = (f.inverse().transpose() * place.axes.row(0).transpose()).normalized().transpose();
        axes.row(1) = (f * place.axes.row(1).transpose()).normalized().transpose();
        if constexpr (Dim == 3) axes.row(2) = axes.row(0).transpose().cross(axes.row(1).transpose()).transpose();
      }
      const Vector<Dim> moved = vortex_.flow(at);
      for (int k = 0; k < Dim; ++k) {
        Vector<Dim> corner = moved;
        const double turn = 2 * std::numbers::pi * k / Dim;
        for (int j = 1; j < Dim; ++j) corner += (j == 1 ? std::cos(turn) : std::sin(turn)) * axes.row(j).transpose();
        for (int a = 0; a < Dim; ++a)
          corners[Oriented::kCornerValues * e + static_cast<std::size_t>(Dim * k + a)] = corner[a];
      }
    }
    std::vector<double> made(velocity_.size(), 0.0);
    momenta_->add_velocity(elements_, corners.data(), values_.data(), made.data());
    return made;
  }

 private:
  Lattice<Dim> lattice_{};
  Vortex<Dim> vortex_;
  std::unique_ptr<Oriented> momenta_;
  std::vector<Element> elements_;
  std::vector<double> values_;
  std::vector<double> velocity_;
};

// What is known of where elements begin is not kept beyond its time.
TEST(OrientedFlow, BeginsWhereElementsAreNow) {
  OrientedOptions<2> options;
  options.lattice = {{30, 30}, {1, 1}, {}};
  options.normals = spread_normals<2>(8);
  options.width_mm = 6;
  using Oriented = OrientedMomenta<2, double>;
  Oriented momenta(options);
  OrientedFlow<2, double> flow(momenta, options.lattice, 1, Evolution::Carried);
  const std::size_t sites = options.lattice.sites();
  const std::vector<std::uint32_t> one = {static_cast<std::uint32_t>(sites + 15 * 30 + 15)},
                                   other = {static_cast<std::uint32_t>(sites + 15 * 30 + 16)};
  const double value = 1;
  const auto begun = [&](const std::vector<std::uint32_t>& elements) {
    std::vector<double> made(2 * sites, 0.0), expected(2 * sites, 0.0), corners;
    flow.begin(&elements, &value);
    flow.add_velocity(0, made.data());
    momenta.place(elements, corners);
    momenta.add_velocity(elements, corners.data(), &value, expected.data());
    EXPECT_EQ(made, expected);
    return made;
  };
  const std::vector<double> first = begun(one);
  EXPECT_NE(begun(other), first);
  EXPECT_EQ(begun(one), first);
  std::vector<double> normals(2 * sites, 0.0);
  const Vector<2> tilted = (options.normals[1] + 0.1 * options.normals[0]).normalized();
  for (int c = 0; c < 2; ++c) normals[2 * (15 * 30 + 15) + c] = tilted[c];
  momenta.turn(normals);
  EXPECT_NE(begun(one), first);
  momenta.turn({});
  EXPECT_EQ(begun(one), first);
}

double relative_difference(const std::vector<double>& a, const std::vector<double>& b) {
  double square = 0, all = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    square += (a[i] - b[i]) * (a[i] - b[i]);
    all += b[i] * b[i];
  }
  return std::sqrt(square / all);
}

template <int Dim>
void expect_the_particle_path(double few_steps, double many_steps) {
  const Experiment<Dim> experiment;
  const std::vector<double> exact = experiment.exact(Plane::Turns);
  const double fixed_normal = relative_difference(experiment.exact(Plane::KeepsItsNormal), exact);
  const double three = relative_difference(experiment.carried(3), exact),
               sixteen = relative_difference(experiment.carried(16), exact);
  EXPECT_LT(three, few_steps);
  EXPECT_LT(sixteen, many_steps);
  EXPECT_GT(fixed_normal, 3 * sixteen) << "the experiment turns planes by enough to be seen";
}

TEST(OrientedFlow, CarriesElementsAsParticlesGo) {
  expect_the_particle_path<2>(0.25, 0.23);
  expect_the_particle_path<3>(0.25, 0.23);
}

// What is left with many steps is the simplex, four cells across, and the velocity between samples: both of second
// order.
TEST(OrientedFlow, ComesCloserWithTheSquareOfTheSpacing) {
  const auto error = [](double spacing) {
    const Experiment<2> experiment(spacing);
    return relative_difference(experiment.carried(64), experiment.exact(Plane::Turns));
  };
  const double coarse = error(1), fine = error(0.5);
  EXPECT_GT(coarse / fine, 2.4);
  EXPECT_LT(coarse / fine, 4.5);
}

}  // namespace
}  // namespace saltus
