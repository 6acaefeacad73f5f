// Which elements are turned, and from which normals: what makes an interface one set, and keeps it that.
#include "core/momenta/oriented_momenta.h"
#include "core/momenta/spread_normals.h"
#include "tests/support/random_fields.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace saltus {
namespace {

template <int Dim>
using Vec = Eigen::Matrix<double, Dim, 1>;

OrientedMomenta<2, double> some_momenta() {
  return OrientedMomenta<2, double>({{{43, 30}, {1, 1}, {}}, spread_normals<2>(8), 3.1, 0.7});
}

/// Normals at every second site that stray from an angle by up to `stray`, degrees.
std::vector<double> straying_normals(const Lattice<2>& lattice, double degrees, double stray, int seed) {
  const std::vector<double> off = testing::random_values(lattice.sites(), static_cast<std::uint64_t>(seed), stray);
  std::vector<double> normals(2 * lattice.sites(), 0.0);
  for (std::size_t site = 0; site < lattice.sites(); site += 2) {
    const double angle = (degrees + off[site]) * M_PI / 180, sign = site % 4 == 0 ? 1 : -1;
    normals[2 * site] = sign * std::cos(angle);
    normals[2 * site + 1] = sign * std::sin(angle);
  }
  return normals;
}

template <class Momenta>
std::vector<std::size_t> normals_in_use(const Momenta& momenta) {
  std::vector<std::size_t> found;
  for (std::uint32_t element : momenta.turned()) found.push_back(momenta.normal_of(element));
  std::sort(found.begin(), found.end());
  found.erase(std::unique(found.begin(), found.end()), found.end());
  return found;
}

// The penalty knows no pairs of two normals: an interface that is nearly plane has one, also where two are as near.
TEST(OrientedTurning, AreTurnedFromAsFewNormalsAsCanBe) {
  auto momenta = some_momenta();
  const Lattice<2>& lattice = momenta.lattice();
  for (double degrees : {11.25, 40.0, 78.0}) {
    momenta.turn(straying_normals(lattice, degrees, 8, 1));
    EXPECT_EQ(momenta.turned().size(), (lattice.sites() + 1) / 2);
    EXPECT_EQ(normals_in_use(momenta).size(), 1u) << degrees;
  }
  std::vector<double> both = straying_normals(lattice, 10, 5, 2);
  const std::vector<double> other = straying_normals(lattice, 100, 5, 3);
  std::copy(other.begin() + static_cast<long>(lattice.sites()), other.end(),
            both.begin() + static_cast<long>(lattice.sites()));
  momenta.turn(both);
  EXPECT_EQ(normals_in_use(momenta).size(), 2u);
  for (std::uint32_t element : momenta.turned()) {
    const Vec<2> own = Eigen::Map<const Vec<2>>(momenta.turned_normals().data() + 2 * momenta.site_of(element));
    EXPECT_GT(own.dot(momenta.options().normals[momenta.normal_of(element)]), std::cos(36 * M_PI / 180));
  }
}

/// Of elements all around a circle (a sphere in 3-D): the smallest share that the axis along which they are dense has
/// of what their normal has along any.
template <int Dim>
double least_steepness(int count, double thickness = 1) {
  Lattice<Dim> cube;
  cube.size.fill(Dim == 2 ? 40 : 16);
  cube.spacing.fill(1);
  cube.spacing[Dim - 1] = thickness;
  OrientedMomenta<Dim, double> momenta({cube, spread_normals<Dim>(count), 3.0, 1.0});
  const Lattice<Dim>& lattice = momenta.lattice();
  std::vector<double> normals(Dim * lattice.sites());
  for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab)
    visit_slab<Dim>(lattice, slab, [&](const Index<Dim>& index, std::size_t site) {
      for (int a = 0; a < Dim; ++a) normals[Dim * site + a] = index[a] - lattice.size[a] / 2 + 0.3;
      Eigen::Map<Vec<Dim>>(normals.data() + Dim * site).normalize();
    });
  momenta.turn(normals);
  EXPECT_EQ(momenta.turned().size(), lattice.sites());
  double least = 1;
  for (std::uint32_t element : momenta.turned()) {
    const Vec<Dim> own = Eigen::Map<const Vec<Dim>>(momenta.turned_normals().data() + Dim * momenta.site_of(element));
    EXPECT_GT(own.dot(momenta.options().normals[momenta.normal_of(element)]),
              std::cos((thickness == 1 ? 55 : 80) * M_PI / 180));
    Vec<Dim> steepness = own.cwiseAbs();
    steepness[Dim - 1] *= thickness;
    least = std::min(least, steepness[momenta.steepest_axis(momenta.normal_of(element))] / steepness.maxCoeff());
  }
  return least;
}

// Elements lie close along the steepest axis of the normal that they are turned from: it is one of theirs as well.
TEST(OrientedTurning, AreTurnedFromNormalsThatAreAsSteep) {
  EXPECT_GE(least_steepness<2>(4), 0.4);
  EXPECT_GE(least_steepness<2>(8), 0.4);
  EXPECT_GE(least_steepness<3>(3), 0.4);
  EXPECT_GE(least_steepness<3>(9), 0.4);
  EXPECT_GE(least_steepness<3>(13), 0.4);
  for (int count : {3, 9, 13}) EXPECT_GE(least_steepness<3>(count, 3), 0.4) << count;
}

// One that has a momentum does not decide for all others.
TEST(OrientedTurning, AreNotTurnedAsOneOfThemIs) {
  auto momenta = some_momenta();
  const Lattice<2>& lattice = momenta.lattice();
  momenta.turn(straying_normals(lattice, 45, 0, 1));
  const std::vector<std::uint32_t> one = {momenta.turned()[momenta.turned().size() / 2]};
  momenta.turn(straying_normals(lattice, 65, 0, 1), one);
  EXPECT_EQ(normals_in_use(momenta).size(), 2u);
  for (std::uint32_t element : momenta.turned()) {
    if (element == one.front()) continue;
    EXPECT_GT(std::abs(momenta.options().normals[momenta.normal_of(element)][1]), 0.9);
  }
}

// What has a momentum does not turn into another element when the interface is seen to turn, and others follow it.
TEST(OrientedTurning, RemainTheSameElementsWhenTurnedAgain) {
  OrientedMomenta<2, double> momenta({{{40, 30}, {1, 1}, {}}, spread_normals<2>(8), 3.0, 1.0});
  const Lattice<2>& lattice = momenta.lattice();
  momenta.turn(straying_normals(lattice, 10, 0, 1));
  const std::size_t first = normals_in_use(momenta).front();
  std::vector<std::uint32_t> active;
  for (std::size_t i = 0; i < momenta.turned().size(); i += 5) active.push_back(momenta.turned()[i]);
  const std::size_t lost = momenta.site_of(active.front());
  const Vec<2> before = Eigen::Map<const Vec<2>>(momenta.turned_normals().data() + 2 * lost);
  std::vector<double> normals = straying_normals(lattice, 28, 0, 1);
  normals[2 * lost] = normals[2 * lost + 1] = 0;  // nothing is seen there any more
  const std::size_t across = momenta.site_of(active.back());
  const Vec<2> kept = Eigen::Map<const Vec<2>>(momenta.turned_normals().data() + 2 * across);
  normals[2 * across] = std::cos(100 * M_PI / 180);  // nor anything near
  normals[2 * across + 1] = std::sin(100 * M_PI / 180);
  OrientedMomenta<2, double> anew(momenta.options());
  anew.turn(normals);
  EXPECT_NE(normals_in_use(anew), std::vector<std::size_t>{first});

  momenta.turn(normals, active);
  EXPECT_EQ(normals_in_use(momenta), std::vector<std::size_t>{first});
  EXPECT_TRUE(std::includes(momenta.turned().begin(), momenta.turned().end(), active.begin(), active.end()));
  EXPECT_EQ((Eigen::Map<const Vec<2>>(momenta.turned_normals().data() + 2 * lost)), before);
  EXPECT_EQ((Eigen::Map<const Vec<2>>(momenta.turned_normals().data() + 2 * across)), kept);
  const Vec<2> turned = Eigen::Map<const Vec<2>>(momenta.turned_normals().data() + 2 * momenta.site_of(active[1]));
  EXPECT_NEAR(turned.dot(Vec<2>(std::cos(28 * M_PI / 180), std::sin(28 * M_PI / 180))), 1, 1e-12);

  // As it was, without asking again.
  anew.restore_turned(momenta.turned_normals(), momenta.turned());
  EXPECT_EQ(anew.turned(), momenta.turned());
  EXPECT_EQ(anew.candidates(), momenta.candidates());
  std::vector<double> corners, restored;
  momenta.place(momenta.turned(), corners);
  anew.place(momenta.turned(), restored);
  EXPECT_EQ(restored, corners);
}

}  // namespace
}  // namespace saltus
