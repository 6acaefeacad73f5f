// Oracles: the sum in the header written out with the kernel profile's own closed forms, sums over all sites and
// elements, and differences of what the adjoint differentiates.
#include "core/momenta/oriented_momenta.h"

#include "core/kernels/kernel_profile.h"
#include "core/momenta/spread_normals.h"
#include "core/support/errors.h"
#include "tests/support/finite_differences.h"
#include "tests/support/lattices.h"
#include "tests/support/many_threads.h"
#include "tests/support/random_fields.h"

#include <gtest/gtest.h>
#include <omp.h>
#include <Eigen/LU>

#include <cmath>
#include <numeric>

namespace saltus {
namespace {

template <int Dim>
using Vec = Eigen::Matrix<double, Dim, 1>;

/// Rows are long enough for whole lanes, and elements wide enough along them for more than one.
template <int Dim>
Lattice<Dim> small_lattice() {
  Lattice<Dim> lattice;
  const int size[3] = {43, 13, 9};
  const double spacing[3] = {0.3, 1.3, 1.6};
  for (int axis = 0; axis < Dim; ++axis) {
    lattice.size[axis] = size[axis];
    lattice.spacing[axis] = spacing[axis];
    lattice.offset[axis] = 0.3 * axis;
  }
  return lattice;
}

template <int Dim>
OrientedMomenta<Dim, double> small_momenta(int spacing = 1, double normal_share = 1) {
  return OrientedMomenta<Dim, double>(
      {small_lattice<Dim>(), spread_normals<Dim>(Dim == 2 ? 8 : 13), 3.1 * spacing, 0.7, spacing, normal_share});
}

/// Every seventh element or so, of all normals.
template <int Dim>
std::vector<std::uint32_t> some_elements(const OrientedMomenta<Dim, double>& momenta) {
  std::vector<std::uint32_t> elements;
  for (std::uint32_t e = 3; e < momenta.elements(); e += Dim == 2 ? 37 : 397) elements.push_back(e);
  return elements;
}

/// k0 averaged over a cell, and its derivative, from antiderivatives and values of the profile.
double averaged_value(const KernelProfile& k0, double cell, double r) {
  return (k0.first_integral(r + cell / 2) - k0.first_integral(r - cell / 2)) / (cell * k0.mass());
}
double averaged_slope(const KernelProfile& k0, double cell, double r) {
  return k0.width() * (k0.value(r + cell / 2) - k0.value(r - cell / 2)) / (cell * k0.mass());
}

TEST(AveragedWendland, IsTheProfileAveragedOverACell) {
  const auto k0 = make_wendland_profile(2.7);
  for (double cell : {0.2, 1.0, 4.0}) {
    const AveragedWendland<double> averaged(2.7, cell);
    for (double r = -7.0031; r < 7; r += 0.13) {
      EXPECT_NEAR(averaged.value(r), averaged_value(*k0, cell, r), 1e-14);
      EXPECT_NEAR(averaged.slope(r), averaged_slope(*k0, cell, r), 1e-13);
      EXPECT_NEAR(averaged.slope_derivative(r), (averaged.slope(r + 1e-6) - averaged.slope(r - 1e-6)) / 2e-6, 1e-6);
      if (std::abs(r) > averaged.reach()) {
        EXPECT_EQ(averaged.slope(r), 0);
        EXPECT_NEAR(averaged.value(r), 0, 1e-16);
      }
    }
  }
}

// At the samples it says what the taps of axis-aligned momenta say.
TEST(AveragedWendland, AgreesWithTheTapsAtTheSamples) {
  const auto k0 = make_wendland_profile(3.3);
  for (double h : {0.4, 1.0, 2.0}) {
    const KernelTaps taps = cell_averaged_taps(*k0, h);
    const AveragedWendland<double> averaged(3.3, h);
    for (int t = -taps.radius; t <= taps.radius; ++t) {
      const auto at = static_cast<std::size_t>(t + taps.radius);
      EXPECT_NEAR(h * averaged.slope((t - 0.5) * h), taps.slope[at], 1e-13);
      EXPECT_NEAR(h * averaged.value_gram(t * h), taps.value[at], 1e-13);
      EXPECT_NEAR(h * averaged.slope_gram(t * h), taps.curvature[at], 1e-12);
    }
  }
}

TEST(SpreadNormals, AreUnitVectorsFarFromEachOtherWithTheAxesFirst) {
  const auto check = [](const auto& normals, int count, double least_angle) {
    ASSERT_EQ(normals.size(), static_cast<std::size_t>(count));
    for (std::size_t i = 0; i < normals.size(); ++i) {
      EXPECT_NEAR(normals[i].norm(), 1, 1e-15);
      for (std::size_t j = 0; j < i; ++j)
        EXPECT_LT(std::abs(normals[i].dot(normals[j])), std::cos((least_angle - 0.01) * M_PI / 180));
    }
    for (int axis = 0; axis < normals[0].size(); ++axis) EXPECT_EQ(normals[static_cast<std::size_t>(axis)][axis], 1);
  };
  check(spread_normals<2>(4), 4, 45);
  check(spread_normals<2>(8), 8, 22.5);
  check(spread_normals<3>(3), 3, 90);
  check(spread_normals<3>(9), 9, 45);
  check(spread_normals<3>(13), 13, 35.2);
  EXPECT_TRUE(spread_normals<2>(0).empty());
  for (int count : {1, 9, 13}) EXPECT_THROW(spread_normals<2>(count), InvalidInput) << count;
  for (int count : {4, 8, 12}) EXPECT_THROW(spread_normals<3>(count), InvalidInput) << count;
}

template <int Dim>
void expect_the_written_sum(int spacing, double normal_share = 1) {
  omp_set_num_threads(1);
  auto momenta = small_momenta<Dim>(spacing, normal_share);
  const Lattice<Dim>& lattice = momenta.lattice();
  // Some sites have a normal of their own.
  std::vector<double> normals(Dim * lattice.sites(), 0.0), drawn = testing::random_values(normals.size(), 3);
  for (std::size_t site = 0; site < lattice.sites(); site += 2)
    Eigen::Map<Vec<Dim>>(normals.data() + Dim * site) = Eigen::Map<Vec<Dim>>(drawn.data() + Dim * site).normalized();
  momenta.turn(normals);
  std::vector<std::uint32_t> elements = some_elements(momenta);
  for (std::size_t i = 0; i<momenta.turned().size(); i += spacing> 1 ? 3 : Dim == 2 ? 9 : 61)
    elements.push_back(momenta.turned()[i]);
  std::sort(elements.begin(), elements.end());
  elements.erase(std::unique(elements.begin(), elements.end()), elements.end());

  const std::vector<double> values = testing::random_values((Dim - 1) * elements.size(), 4);
  std::vector<double> corners, velocity(Dim * lattice.sites(), 0.25), wanted = velocity;
  momenta.place(elements, corners);
  momenta.add_velocity(elements, corners.data(), values.data(), velocity.data());

  const auto k0 = make_wendland_profile(momenta.options().width_mm),
             along_normal = make_wendland_profile(normal_share * momenta.options().width_mm);
  const auto untouched = small_momenta<Dim>(spacing);
  std::size_t turned = 0;
  for (std::size_t e = 0; e < elements.size(); ++e) {
    const auto place = OrientedMomenta<Dim, double>::placement(corners.data() + Dim * Dim * e);
    // Where and which way it should be.
    std::size_t rest = momenta.site_of(elements[e]);
    for (int a = 0; a < Dim; ++a) {
      EXPECT_NEAR(place.at[a], lattice.offset[a] + static_cast<double>(rest % lattice.size[a]) * lattice.spacing[a],
                  1e-12);
      rest /= static_cast<std::size_t>(lattice.size[a]);
    }
    EXPECT_NEAR((place.axes * place.axes.transpose() - Eigen::Matrix<double, Dim, Dim>::Identity()).norm(), 0, 1e-12);
    EXPECT_NEAR(place.axes.determinant(), 1, 1e-12);
    const bool is_turned = std::binary_search(momenta.turned().begin(), momenta.turned().end(), elements[e]);
    turned += is_turned;
    const Vec<Dim> own = Eigen::Map<const Vec<Dim>>(normals.data() + Dim * momenta.site_of(elements[e])),
                   given = momenta.options().normals[momenta.normal_of(elements[e])];
    EXPECT_NEAR(std::abs(place.axes.row(0).dot((is_turned ? own : given).transpose())), 1, 1e-12);
    EXPECT_GT(place.axes.row(0).dot(given.transpose()), is_turned ? 0.7 : 1 - 1e-12);

    // Cells are those of the option's normal: what is turned keeps them.
    std::vector<double> straight;
    untouched.place({elements[e]}, straight);
    const auto axes = OrientedMomenta<Dim, double>::placement(straight.data()).axes;
    double cell[Dim];
    for (int k = 0; k < Dim; ++k) {
      double square = 0;
      for (int a = 0; a < Dim; ++a) {
        int apart = k == 0 ? 1 : spacing;  // but no more than half a width
        while (apart > 1 && apart * lattice.spacing[a] > momenta.options().width_mm / 2) --apart;
        square += std::pow(axes(k, a) * apart * lattice.spacing[a], 2);
      }
      cell[k] = std::sqrt(square);
    }
    for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab)
      visit_slab<Dim>(lattice, slab, [&](const Index<Dim>& index, std::size_t site) {
        Vec<Dim> x;
        for (int a = 0; a < Dim; ++a) x[a] = lattice.offset[a] + index[a] * lattice.spacing[a];
        const Vec<Dim> r = place.axes * (x - place.at);
        double shape = momenta.options().weight * lattice.cell_volume() * averaged_slope(*along_normal, cell[0], r[0]);
        for (int k = 1; k < Dim; ++k) shape *= averaged_value(*k0, cell[k], r[k]);
        for (int j = 1; j < Dim; ++j)
          for (int a = 0; a < Dim; ++a)
            wanted[Dim * site + a] += shape * values[(Dim - 1) * e + j - 1] * place.axes(j, a);
      });
  }
  EXPECT_GT(turned, 5u);
  EXPECT_LT(turned + 5, elements.size());
  double largest = 0;
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    EXPECT_NEAR(velocity[i], wanted[i], 1e-12);
    largest = std::max(largest, std::abs(wanted[i] - 0.25));
  }
  EXPECT_GT(largest, 0.01);
}

TEST(OrientedMomenta, MakeTheSumOverElements2d) { expect_the_written_sum<2>(1); }
TEST(OrientedMomenta, MakeTheSumOverElements3d) { expect_the_written_sum<3>(1); }
TEST(OrientedMomenta, MakeTheSumOverElementsApart2d) { expect_the_written_sum<2>(2); }
TEST(OrientedMomenta, MakeTheSumOverElementsApart3d) { expect_the_written_sum<3>(3); }
TEST(OrientedMomenta, MakeTheSumOverNarrowElements2d) { expect_the_written_sum<2>(2, 0.4); }
TEST(OrientedMomenta, MakeTheSumOverNarrowElements3d) { expect_the_written_sum<3>(3, 0.5); }

// Oracle: the sum as it is written, of elements that reach more rows than are looked at together.
template <int Dim, class T>
void expect_the_written_sum_of_wide_ones(double tolerance) {
  Lattice<Dim> lattice;
  for (int axis = 0; axis < Dim; ++axis) {
    lattice.size[axis] = axis == 0 ? 37 : axis == 1 ? 101 : 3;
    lattice.spacing[axis] = 1.0 + 0.1 * axis;
  }
  const OrientedMomenta<Dim, T> momenta({lattice, spread_normals<Dim>(Dim == 2 ? 8 : 13), 45, 0.7, 1});
  std::vector<std::uint32_t> elements;
  for (std::uint32_t e = 301; e < momenta.elements(); e += Dim == 2 ? 1511 : 8803) elements.push_back(e);
  ASSERT_GT(elements.size(), 10u);
  const std::vector<double> drawn = testing::random_values((Dim - 1) * elements.size(), 11);
  const std::vector<T> values(drawn.begin(), drawn.end());
  std::vector<T> corners, velocity(Dim * lattice.sites(), T(0));
  momenta.place(elements, corners);
  momenta.add_velocity(elements, corners.data(), values.data(), velocity.data());

  const auto k0 = make_wendland_profile(momenta.options().width_mm);
  std::vector<double> wanted(velocity.size(), 0.0);
  for (std::size_t e = 0; e < elements.size(); ++e) {
    const auto place = OrientedMomenta<Dim, T>::placement(corners.data() + Dim * Dim * e);
    const Eigen::Matrix<double, Dim, Dim> axes = place.axes.template cast<double>();
    double cell[Dim];
    for (int k = 0; k < Dim; ++k) cell[k] = cell_along<Dim>(lattice, axes.row(k).transpose());
    for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab)
      visit_slab<Dim>(lattice, slab, [&](const Index<Dim>& index, std::size_t site) {
        Vec<Dim> x;
        for (int a = 0; a < Dim; ++a) x[a] = lattice.offset[a] + index[a] * lattice.spacing[a];
        const Vec<Dim> r = axes * (x - place.at.template cast<double>());
        double shape = momenta.options().weight * lattice.cell_volume() * averaged_slope(*k0, cell[0], r[0]);
        for (int k = 1; k < Dim; ++k) shape *= averaged_value(*k0, cell[k], r[k]);
        for (int j = 1; j < Dim; ++j)
          for (int a = 0; a < Dim; ++a)
            wanted[Dim * site + static_cast<std::size_t>(a)] +=
                shape * drawn[(Dim - 1) * e + static_cast<std::size_t>(j) - 1] * axes(j, a);
      });
  }
  double largest = 0;
  for (double value : wanted) largest = std::max(largest, std::abs(value));
  for (std::size_t i = 0; i < wanted.size(); ++i) ASSERT_NEAR(velocity[i], wanted[i], tolerance * largest) << i;
  for (std::size_t row : {0u, 50u, 100u})  // something is to be seen in all of them
    EXPECT_GT(std::abs(wanted[Dim * (37 * row + 18)]), 1e-3 * largest) << row;
}

TEST(OrientedMomenta, MakeTheSumOverWideElements2d) {
  expect_the_written_sum_of_wide_ones<2, double>(1e-12);
  expect_the_written_sum_of_wide_ones<2, float>(1e-4);
}
TEST(OrientedMomenta, MakeTheSumOverWideElements3d) {
  expect_the_written_sum_of_wide_ones<3, double>(1e-12);
  expect_the_written_sum_of_wide_ones<3, float>(1e-4);
}

// A plane across an axis: there is nothing to be seen of the elements that make it.
TEST(OrientedMomenta, TileAPlane) {
  const int size = 30, at = 14;
  const auto lattice = testing::unit_lattice<3>({size, size, size});
  std::vector<double> velocities[2];
  for (int spacing : {1, 3}) {
    OrientedMomenta<3, double> momenta({lattice, spread_normals<3>(9), 6, 1.0, spacing});
    std::vector<double> normals(3 * lattice.sites(), 0.0), corners;
    for (std::size_t row = 0; row < lattice.sites(); row += size) normals[3 * (row + at)] = 1;
    momenta.turn(normals);
    const std::vector<std::uint32_t>& elements = momenta.candidates();
    ASSERT_EQ(momenta.turned().size(), static_cast<std::size_t>(size * size));
    ASSERT_EQ(elements.size(), static_cast<std::size_t>(size * size / (spacing * spacing)));
    EXPECT_EQ(momenta.sites_of_each(0), spacing * spacing);
    for (std::uint32_t element : elements) {
      const std::size_t site = momenta.site_of(element);
      EXPECT_EQ(site % size, static_cast<std::size_t>(at));
      EXPECT_EQ(site / size % size % static_cast<std::size_t>(spacing), 0u);
      EXPECT_EQ(site / size / size % static_cast<std::size_t>(spacing), 0u);
    }
    const std::vector<double> values(2 * elements.size(), spacing * spacing);
    std::vector<double>& velocity = velocities[spacing > 1];
    velocity.assign(3 * lattice.sites(), 0.0);
    momenta.place(elements, corners);
    momenta.add_velocity(elements, corners.data(), values.data(), velocity.data());
  }
  for (int z = 9; z < 20; ++z)
    for (int y = 9; y < 20; ++y)
      for (int x = 0; x < size; ++x)
        for (int c = 0; c < 3; ++c) {
          const std::size_t i = static_cast<std::size_t>(3 * ((z * size + y) * size + x) + c);
          EXPECT_NEAR(velocities[1][i], velocities[0][i], 1e-13);
          EXPECT_NEAR(velocities[1][i], velocities[1][static_cast<std::size_t>(3 * ((9 * size + 9) * size + x) + c)],
                      1e-13);
          if (c > 0 && std::abs(x - at) < 4 && x != at) {
            EXPECT_GT(std::abs(velocities[0][i]), 0.05);
          }
        }
}

// The union over the normals, counted by asking each.
TEST(OrientedMomenta, HaveRoomAtSoManySites) {
  Lattice<3> lattice;
  lattice.size = {7, 8, 11};
  lattice.spacing = {1, 1.5, 4};
  OrientedOptions<3> options{lattice, {}, 6, 1, 3};
  for (int a = 0; a < 3; ++a) options.normals.push_back(Eigen::Vector3d::Unit(a));
  OrientedMomenta<3, double> momenta(options);
  std::set<std::size_t> sites;
  for (const Eigen::Vector3d& normal : options.normals) {
    std::vector<double> normals(3 * lattice.sites());
    for (std::size_t i = 0; i < normals.size(); ++i) normals[i] = normal[static_cast<Eigen::Index>(i % 3)];
    momenta.turn(normals);
    for (const auto element : momenta.candidates()) sites.insert(momenta.site_of(element));
  }
  EXPECT_EQ(sites_apart(lattice, options.width_mm, options.spacing), (Index<3>{3, 2, 1}));
  EXPECT_EQ(sites_with_room(lattice, options.width_mm, options.spacing), sites.size());
}

// A plane at 37 degrees from z, in voxels as wide as high and in thick slices: one element for as much of it, and no
// holes.
TEST(OrientedMomenta, CoverAPlaneInThickSlices) {
  for (double slice : {1.0, 3.0, 5.0}) {
    Lattice<3> lattice = testing::unit_lattice<3>({48, 48, static_cast<int>(48 / slice)});
    lattice.spacing[2] = slice;
    OrientedMomenta<3, double> momenta({lattice, spread_normals<3>(9), 6, 1.0, 3});
    const Vec<3> n(std::sin(0.65), 0, std::cos(0.65)), middle(24, 24, 24);
    std::vector<double> normals(3 * lattice.sites(), 0.0), corners;
    const auto place_of = [&](std::size_t site) {
      const std::size_t x = site % 48, y = site / 48 % 48, z = site / (48 * 48);
      return Vec<3>(static_cast<double>(x), static_cast<double>(y), slice * static_cast<double>(z));
    };
    for (std::size_t site = 0; site < lattice.sites(); ++site) Eigen::Map<Vec<3>>(normals.data() + 3 * site) = n;
    momenta.turn(normals);
    const int steepest = momenta.steepest_axis(momenta.normal_of(momenta.candidates().front()));
    EXPECT_EQ(steepest, slice > 1 ? 2 : 0);
    const double reach = std::abs(n[steepest]) * lattice.spacing[steepest] / 2;
    std::vector<std::uint32_t> elements;  // those nearest to the plane, one above each that has room in it
    for (std::uint32_t element : momenta.candidates())
      if (const double off = n.dot(place_of(momenta.site_of(element)) - middle); off > -reach && off <= reach)
        elements.push_back(element);
    std::vector<double> velocity(3 * lattice.sites(), 0.0);
    const std::vector<double> values(2 * elements.size(), 1.0);
    momenta.place(elements, corners);
    momenta.add_velocity(elements, corners.data(), values.data(), velocity.data());
    double least = 1e300, most = 0;
    for (std::size_t site = 0; site < lattice.sites(); ++site) {
      const Vec<3> x = place_of(site) - middle;
      if (x.norm() > 12 || std::abs(std::abs(n.dot(x)) - 3) > 0.5) continue;
      const double size = Eigen::Map<const Vec<3>>(velocity.data() + 3 * site).norm();
      least = std::min(least, size);
      most = std::max(most, size);
    }
    EXPECT_GT(least, 0.4 * most) << slice;
  }
}

template <int Dim>
void expect_the_exact_adjoint(double normal_share = 1) {
  using testing::dot;
  auto momenta = small_momenta<Dim>(1, normal_share);
  const std::vector<std::uint32_t> elements = some_elements(momenta);
  std::vector<double> corners;
  momenta.place(elements, corners);
  // Anywhere, turned anyhow, and some without a momentum.
  const std::vector<double> nudges = testing::random_values(corners.size(), 7, 0.3);
  for (std::size_t i = 0; i < corners.size(); ++i) corners[i] += nudges[i];
  std::vector<double> values = testing::random_values((Dim - 1) * elements.size(), 8);
  for (std::size_t e = 0; e < elements.size(); e += 3)
    std::fill_n(values.begin() + static_cast<std::ptrdiff_t>((Dim - 1) * e), Dim - 1, 0.0);
  const std::size_t field = Dim * momenta.lattice().sites();
  const std::vector<double> dual = testing::random_values(field, 9);
  const auto paired = [&](const std::vector<double>& at, const std::vector<double>& with) {
    std::vector<double> velocity(field, 0.0);
    momenta.add_velocity(elements, at.data(), with.data(), velocity.data());
    return dot(velocity, dual);
  };
  std::vector<double> values_dual(values.size(), 0.0), corners_dual(corners.size(), 0.0), alone(values.size(), 0.0);
  momenta.add_velocity_adjoint(elements, corners.data(), values.data(), dual.data(), values_dual.data(),
                               corners_dual.data());
  momenta.add_velocity_adjoint(elements, corners.data(), values.data(), dual.data(), alone.data(), nullptr);
  // Linear in the momenta, also in those that are 0.
  const std::vector<double> others = testing::random_values(values.size(), 10);
  EXPECT_NEAR(dot(values_dual, others), paired(corners, others), 1e-11);
  for (std::size_t i = 0; i < alone.size(); ++i) EXPECT_NEAR(alone[i], values_dual[i], 1e-13);
  for (int direction = 0; direction < 4; ++direction) {
    const std::vector<double> along = testing::random_values(corners.size(), 20 + direction);
    const double slope = testing::slope_along([&](const auto& at) { return paired(at, values); }, corners, along);
    EXPECT_NEAR(dot(corners_dual, along), slope, 1e-5 * (1 + std::abs(slope)));
    EXPECT_GT(std::abs(slope), 1e-3);
  }
}

TEST(OrientedMomenta, HaveTheExactAdjoint2d) { expect_the_exact_adjoint<2>(); }
TEST(OrientedMomenta, HaveTheExactAdjoint3d) { expect_the_exact_adjoint<3>(); }
TEST(OrientedMomenta, HaveTheExactAdjointWhereTheyAreNarrow2d) { expect_the_exact_adjoint<2>(0.4); }
TEST(OrientedMomenta, HaveTheExactAdjointWhereTheyAreNarrow3d) { expect_the_exact_adjoint<3>(0.5); }

// Other registers, other numbers of them in a row.
template <int Dim>
void expect_single_precision_to_agree() {
  const auto wide = small_momenta<Dim>();
  const OrientedMomenta<Dim, float> narrow({wide.lattice(), wide.options().normals, 3.1, 0.7});
  const std::vector<std::uint32_t> elements = some_elements(wide);
  const std::vector<double> values = testing::random_values((Dim - 1) * elements.size(), 8),
                            dual = testing::random_values(Dim * wide.lattice().sites(), 9);
  const auto all_of = [&](const auto& momenta, auto zero) {
    using T = decltype(zero);
    const std::vector<T> own(values.begin(), values.end()), from(dual.begin(), dual.end());
    std::vector<T> corners, velocity(from.size()), pulls(own.size()), forces, gradient(own.size());
    momenta.place(elements, corners);
    forces.resize(corners.size());
    momenta.add_velocity(elements, corners.data(), own.data(), velocity.data());
    momenta.add_velocity_adjoint(elements, corners.data(), own.data(), from.data(), pulls.data(), forces.data());
    momenta.penalty(elements, own.data(), gradient.data());
    std::vector<std::vector<double>> results;
    for (const std::vector<T>* one : {&velocity, &pulls, &forces, &gradient})
      results.emplace_back(one->begin(), one->end());
    return results;
  };
  const auto exact = all_of(wide, 0.0), rounded = all_of(narrow, 0.0F);
  for (std::size_t k = 0; k < exact.size(); ++k) {
    double largest = 0, off = 0;
    for (std::size_t i = 0; i < exact[k].size(); ++i) {
      largest = std::max(largest, std::abs(exact[k][i]));
      off = std::max(off, std::abs(exact[k][i] - rounded[k][i]));
    }
    EXPECT_GT(largest, 0.01) << k;
    EXPECT_LT(off, 2e-5 * largest) << k;
  }
}

TEST(OrientedMomenta, AgreeInSinglePrecision2d) { expect_single_precision_to_agree<2>(); }
TEST(OrientedMomenta, AgreeInSinglePrecision3d) { expect_single_precision_to_agree<3>(); }

template <int Dim>
void expect_threads_to_change_nothing() {
  const testing::ManyThreads many;
  auto momenta = small_momenta<Dim>();
  const std::vector<std::uint32_t> elements = some_elements(momenta);
  const std::vector<double> values = testing::random_values((Dim - 1) * elements.size(), 8);
  const std::vector<double> dual = testing::random_values(Dim * momenta.lattice().sites(), 9);
  std::vector<double> results[2];
  for (int threads : {1, 2}) {
    omp_set_num_threads(threads);
    std::vector<double> corners, gradient(values.size(), 0.0);
    momenta.place(elements, corners);
    std::vector<double>& all = results[threads - 1];
    all.assign(dual.size(), 0.0);
    momenta.add_velocity(elements, corners.data(), values.data(), all.data());
    all.push_back(momenta.penalty(elements, values.data(), gradient.data()));
    std::vector<double> corners_dual(corners.size(), 0.0);
    momenta.add_velocity_adjoint(elements, corners.data(), values.data(), dual.data(), gradient.data(),
                                 corners_dual.data());
    all.insert(all.end(), gradient.begin(), gradient.end());
    all.insert(all.end(), corners_dual.begin(), corners_dual.end());
  }
  EXPECT_EQ(results[0], results[1]);
}

TEST(OrientedMomenta, DoNotDependOnTheNumberOfThreads) {
  expect_threads_to_change_nothing<2>();
  expect_threads_to_change_nothing<3>();
}

// A layer of elements along a line of any angle makes the jump that a layer of axis-aligned momenta makes.
TEST(OrientedMomenta, JumpByTheSameAtEveryAngle) {
  const auto lattice = testing::unit_lattice<2>({61, 61});
  const double sigma = 6, half_width = 0.5;
  for (double degrees : {0.0, 22.5, 45.0, 67.5, 90.0})
    for (double normal_share : {1.0, 0.5}) {
      OrientedMomenta<2, double> momenta({lattice, spread_normals<2>(8), sigma / normal_share, 1.0, 1, normal_share});
      const double angle = degrees * M_PI / 180;
      const Vec<2> n(std::cos(angle), std::sin(angle)), middle(30, 30);
      std::size_t normal = 0;
      for (std::size_t k = 0; k < 8; ++k)
        if (std::abs(momenta.options().normals[k].dot(n)) > 1 - 1e-9) normal = k;
      // Sites within half a sample of the line, with what makes one momentum of size 1 for each unit of its length.
      std::vector<std::uint32_t> elements;
      double total = 0;
      for (int y = 0; y < 61; ++y)
        for (int x = 0; x < 61; ++x)
          if (std::abs(n.dot(Vec<2>(x, y) - middle)) <= half_width) {
            elements.push_back(static_cast<std::uint32_t>(normal * lattice.sites() + 61 * y + x));
            total += (Vec<2>(x, y) - middle).norm() < 20;
          }
      const std::vector<double> values(elements.size(), 40 / total);
      std::vector<double> corners, velocity(2 * lattice.sites(), 0.0);
      momenta.place(elements, corners);
      momenta.add_velocity(elements, corners.data(), values.data(), velocity.data());
      // On either side sigma / mass k0' of the distance: 2 / mass at the line itself, a jump of 4 / mass.
      const double mass = 2 * sigma / 3;
      for (double distance : {-4.0, -2.0, 2.0, 4.0}) {
        const Vec<2> at = middle + distance * n;
        const Vec<2> sample(std::round(at[0]), std::round(at[1]));
        const auto site = static_cast<std::size_t>(61 * sample[1] + sample[0]);
        const double r = n.dot(sample - middle), sign = r > 0 ? -1 : 1;
        const Vec<2> t(-n[1], n[0]), v(velocity[2 * site], velocity[2 * site + 1]);
        const double given = momenta.options().normals[normal].dot(n);  // its own sign
        EXPECT_NEAR(t.dot(v), given * given * sign * 2 / mass * (1 - std::abs(r) / sigma), 0.03) << degrees;
        EXPECT_NEAR(n.dot(v), 0, 1e-12);
      }
    }
}

TEST(OrientedMomenta, RefuseNormalsThatAreNone) {
  EXPECT_THROW((OrientedMomenta<2, float>({small_lattice<2>(), {Vec<2>(1, 1)}, 3.0, 1.0})), InvalidInput);
  EXPECT_THROW((OrientedMomenta<2, float>({small_lattice<2>(), spread_normals<2>(8), 3.0, 1.0, 0})), InvalidInput);
}

}  // namespace
}  // namespace saltus
