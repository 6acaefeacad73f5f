#include "core/grid/warp.h"

#include "core/grid/interpolation.h"

#include <gtest/gtest.h>
#include <omp.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <utility>

#include "tests/support/finite_differences.h"
#include "tests/support/many_threads.h"
#include "tests/support/random_fields.h"

namespace saltus {
namespace {

using testing::dot;
using testing::random_values;

template <int Dim>
FramedImage<Dim, double> oblique_image(const std::vector<double>* samples = nullptr) {
  FramedImage<Dim, double> image;
  if constexpr (Dim == 2) {
    image.lattice = {{15, 12}, {1, 1}, {}};
    image.linear = Vector<2>(0.8, 1.3).asDiagonal() * Eigen::Rotation2Dd(0.5).toRotationMatrix();
    image.offset = Vector<2>(4.2, 1.1);
  } else {
    image.lattice = {{9, 10, 7}, {1, 1, 1}, {}};
    image.linear =
        Vector<3>(0.9, 1.2, 0.6).asDiagonal() *
        (Eigen::AngleAxisd(0.4, Vector<3>::UnitY()) * Eigen::AngleAxisd(0.7, Vector<3>::UnitX())).toRotationMatrix();
    image.offset = Vector<3>(0.7, 4.1, 1.3);
  }
  image.samples = samples ? *samples : random_values(image.lattice.sites(), 1);
  return image;
}

/// One whose index coordinates are mm.
template <int Dim, class T>
FramedImage<Dim, T> plain_image(const Lattice<Dim>& lattice, std::vector<T> samples) {
  return {lattice, std::move(samples), Matrix<Dim>::Identity(), Vector<Dim>::Zero()};
}

template <int Dim>
Lattice<Dim> points() {
  if constexpr (Dim == 2)
    return {{7, 6}, {1.1, 1.6}, {0.5, -0.3}};
  else
    return {{5, 4, 6}, {1.1, 1.6, 0.9}, {0.5, -0.3, 1}};
}

// Oracle: a linear image, whose value at linear * (x + u) + offset is known.
template <int Dim>
void expect_value_at_the_mapped_place() {
  FramedImage<Dim, double> image = oblique_image<Dim>();
  Vector<Dim> slope;
  for (int axis = 0; axis < Dim; ++axis) slope[axis] = 0.7 - axis;
  for (int slab = 0; slab < image.lattice.size[Dim - 1]; ++slab)
    visit_slab<Dim>(image.lattice, slab, [&](const Index<Dim>& i, std::size_t site) {
      image.samples[site] = 2;
      for (int axis = 0; axis < Dim; ++axis) image.samples[site] += slope[axis] * i[axis];
    });
  const Lattice<Dim> where = points<Dim>();
  const std::vector<double> u = random_values(Dim * where.sites(), 2, 0.4);
  std::vector<double> out(where.sites());
  warp<Dim, double>(image, where, u.data(), out.data());
  for (int slab = 0; slab < where.size[Dim - 1]; ++slab)
    visit_slab<Dim>(where, slab, [&](const Index<Dim>& i, std::size_t site) {
      Vector<Dim> p;
      for (int c = 0; c < Dim; ++c) p[c] = i[c] * where.spacing[c] + where.offset[c] + u[Dim * site + c];
      Vector<Dim> index = image.linear * p + image.offset;
      for (int c = 0; c < Dim; ++c) index[c] = std::clamp(index[c], 0.0, image.lattice.size[c] - 1.0);
      ASSERT_NEAR(out[site], 2 + slope.dot(index), 1e-11);
    });
}

TEST(Warp, ReadsAnObliqueImageWhereThePointIs) {
  expect_value_at_the_mapped_place<2>();
  expect_value_at_the_mapped_place<3>();
}

// Oracle: <warp'(u) w, dual> = <w, warp_adjoint(dual)> for two images, the left side by central differences.
template <int Dim>
void expect_adjoint() {
  const FramedImage<Dim, double> image = oblique_image<Dim>();
  FramedImage<Dim, double> other = image;
  other.samples = random_values(image.samples.size(), 6);
  const Lattice<Dim> where = points<Dim>();
  const std::vector<double> u = random_values(Dim * where.sites(), 3, 0.4), w = random_values(u.size(), 4),
                            dual = random_values(where.sites(), 5), other_dual = random_values(where.sites(), 7);
  const double slope = testing::slope_along(
      [&](const std::vector<double>& at) {
        std::vector<double> out(where.sites()), other_out(where.sites());
        warp<Dim, double>(image, where, at.data(), out.data());
        warp<Dim, double>(other, where, at.data(), other_out.data());
        return dot(out, dual) + dot(other_out, other_dual);
      },
      u, w, 1e-7);
  const std::vector<WarpedDual<Dim, double>> both = {{&image, dual.data()}, {&other, other_dual.data()}};
  std::vector<double> u_dual(u.size(), 2.0);  // what was there is overwritten
  warp_adjoint<Dim, double>(both, where, u.data(), u_dual.data());
  EXPECT_GT(std::abs(slope), 0.1);
  EXPECT_NEAR(dot(u_dual, w), slope, 1e-6 * std::sqrt(dot(dual, dual)));

  std::vector<double> in_place = u;
  warp_adjoint<Dim, double>(both, where, in_place.data(), in_place.data());
  EXPECT_EQ(in_place, u_dual);

  // Of one image, by the slopes that the warp has kept, at their own place as well.
  std::vector<double> out(where.sites()), slopes(u.size()), expected(u.size());
  warp<Dim, double>(image, where, u.data(), out.data(), slopes.data());
  warp_adjoint<Dim, double>({{&image, dual.data()}}, where, u.data(), expected.data());
  warp_adjoint<Dim, double>(dual.data(), slopes.data(), where, nullptr, u_dual.data());
  warp_adjoint<Dim, double>(dual.data(), slopes.data(), where, nullptr, slopes.data());
  for (std::size_t i = 0; i < expected.size(); ++i) ASSERT_NEAR(u_dual[i], expected[i], 1e-13);
  EXPECT_EQ(slopes, u_dual);
}

TEST(Warp, HasAnAdjoint) {
  expect_adjoint<2>();
  expect_adjoint<3>();
}

// Oracle: the displacement interpolated to the sites as a whole, and the transpose of that.
template <int Dim>
void expect_interpolated_displacement() {
  const FramedImage<Dim, double> image = oblique_image<Dim>();
  const Lattice<Dim> where = points<Dim>();
  Lattice<Dim> coarse = where;
  for (int axis = 0; axis < Dim; ++axis) {
    coarse.size[axis] = where.size[axis] / 2 + 1;
    coarse.spacing[axis] = 1.9 * where.spacing[axis];
    coarse.offset[axis] = where.offset[axis] - 0.3;
  }
  const std::vector<double> field = random_values(Dim * coarse.sites(), 2, 0.8), dual = random_values(where.sites(), 3);
  LatticeInterpolation<Dim, double> to_sites(coarse, where, Dim);
  ASSERT_FALSE(to_sites.is_identity());
  std::vector<double> u(Dim * where.sites(), 0.0), out(where.sites()), expected(where.sites());
  to_sites.add_to(field.data(), u.data());
  warp<Dim, double>(image, where, u.data(), expected.data());
  std::vector<double> u_dual(u.size()), field_dual(field.size(), 2.0), expected_dual(field.size());
  warp_adjoint<Dim, double>({{&image, dual.data()}}, where, u.data(), u_dual.data());
  to_sites.transpose(u_dual.data(), expected_dual.data());

  const testing::ManyThreads many;
  for (int threads : {1, 2, 5}) {
    omp_set_num_threads(threads);
    const Displacement<Dim, double> displacement{field.data(), &to_sites};
    warp<Dim, double>(image, where, displacement, out.data());
    warp_adjoint<Dim, double>({{&image, dual.data()}}, where, displacement, field_dual.data());
    for (std::size_t i = 0; i < out.size(); ++i) ASSERT_NEAR(out[i], expected[i], 1e-13);
    for (std::size_t i = 0; i < field.size(); ++i) ASSERT_NEAR(field_dual[i], expected_dual[i], 1e-12);
    std::vector<double> slopes(u.size());
    warp<Dim, double>(image, where, displacement, out.data(), slopes.data());
    warp_adjoint<Dim, double>(dual.data(), slopes.data(), where, &to_sites, field_dual.data());
    for (std::size_t i = 0; i < out.size(); ++i) ASSERT_NEAR(out[i], expected[i], 1e-13);
    for (std::size_t i = 0; i < field.size(); ++i) ASSERT_NEAR(field_dual[i], expected_dual[i], 1e-12);
  }
}

TEST(Warp, InterpolatesACoarseDisplacement) {
  expect_interpolated_displacement<2>();
  expect_interpolated_displacement<3>();
}

// Rows longer than what is taken at a time. Oracle: LinearCell, site by site.
TEST(Warp, TakesRowsOfAnyLength) {
  for (int width : {1, 15, 16, 17, 50}) {
    const Lattice<3> lattice{{width, 3, 4}, {1, 1, 1}, {}};
    const FramedImage<3, double> image = plain_image(lattice, random_values(lattice.sites(), 1));
    const std::vector<double> u = random_values(3 * lattice.sites(), 2, 1.5), dual = random_values(lattice.sites(), 3);
    std::vector<double> out(lattice.sites()), u_dual(u.size());
    warp<3, double>(image, lattice, u.data(), out.data());
    warp_adjoint<3, double>({{&image, dual.data()}}, lattice, u.data(), u_dual.data());
    for (int z = 0; z < 4; ++z)
      visit_slab<3>(lattice, z, [&](const Index<3>& index, std::size_t site) {
        const LinearCell<3, double> cell(
            lattice, {index[0] + u[3 * site], index[1] + u[3 * site + 1], index[2] + u[3 * site + 2]});
        ASSERT_NEAR(out[site], cell.value<1>(image.samples.data())[0], 1e-13) << width << " " << site;
        const auto gradient = cell.pulled_back_gradient<1>(image.samples.data(), {dual[site]});
        for (std::size_t c = 0; c < 3; ++c) ASSERT_NEAR(u_dual[3 * site + c], gradient[c], 1e-13) << width;
      });
  }
}

// Oracle: central differences, which are the mean of both sides where cells meet. Some points lie on a sample, others
// between two along one axis or all.
template <int Dim, class T>
void expect_mean_slopes_on_samples(int width) {
  SCOPED_TRACE(width);
  Lattice<Dim> lattice;
  lattice.size.fill(6);
  lattice.spacing.fill(1);
  lattice.size[0] = width;
  const std::size_t sites = lattice.sites();
  const std::vector<double> noise = random_values(sites, 1);
  const FramedImage<Dim, T> image = plain_image(lattice, std::vector<T>(noise.begin(), noise.end()));
  std::vector<T> u(Dim * sites, T(0));
  for (std::size_t site = 0; site < sites; site += 3)
    for (std::size_t axis = 0; axis < Dim; ++axis)
      if (axis == site / 3 % (Dim + 1) || site / 3 % (Dim + 1) == Dim) u[Dim * site + axis] = T(0.25);
  const std::vector<double> some = random_values(sites, 2);
  const std::vector<T> dual(some.begin(), some.end());
  std::vector<T> out(sites), slopes(Dim * sites), u_dual(Dim * sites), above(sites), below(sites);
  warp<Dim, T>(image, lattice, u.data(), out.data(), slopes.data(), OnSample::Mean);
  warp_adjoint<Dim, T>({{&image, dual.data()}}, lattice, u.data(), u_dual.data(), OnSample::Mean);
  const T step = T(1) / 64;  // piecewise linear along an axis: no error but rounding
  const T close = 200 * std::numeric_limits<T>::epsilon();
  int kinks = 0;
  for (int axis = 0; axis < Dim; ++axis) {
    const auto warp_at = [&](T by, std::vector<T>& moved) {
      std::vector<T> at = u;
      for (std::size_t site = 0; site < sites; ++site) at[Dim * site + axis] += by;
      warp<Dim, T>(image, lattice, at.data(), moved.data());
    };
    warp_at(step, above);
    warp_at(-step, below);
    for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab)
      visit_slab<Dim>(lattice, slab, [&](const Index<Dim>& index, std::size_t site) {
        if (index[axis] == 0 || index[axis] == lattice.size[axis] - 1) return;  // 0 at the border
        const T expected = (above[site] - below[site]) / (2 * step);
        if (std::abs(above[site] + below[site] - 2 * out[site]) > T(0.1) * step) ++kinks;
        ASSERT_NEAR(slopes[Dim * site + axis], expected, close);
        ASSERT_NEAR(u_dual[Dim * site + axis], dual[site] * expected, close);
      });
  }
  EXPECT_GT(kinks, static_cast<int>(sites) / 4);
}

TEST(Warp, HasTheMeanSlopeOfBothSidesOnASample) {
  for (int width : {5, 16, 37}) {
    expect_mean_slopes_on_samples<2, double>(width);
    expect_mean_slopes_on_samples<3, double>(width);
    expect_mean_slopes_on_samples<2, float>(width);
    expect_mean_slopes_on_samples<3, float>(width);
  }
}

// Where a dual is 0 the image need not be a number.
TEST(Warp, HasNoAdjointOfWhatDoesNotCount) {
  const Lattice<2> lattice{{6, 5}, {1, 1}, {}};
  FramedImage<2, double> image = plain_image(lattice, std::vector<double>(lattice.sites(), 0.0));
  std::vector<double> u(2 * lattice.sites(), 0.3), dual(lattice.sites(), 0.0), u_dual(u.size(), 7.0);
  // In the same row there is what counts and what does not.
  for (std::size_t site = 0; site < lattice.sites(); ++site)
    image.samples[site] = site % 6 < 3 ? static_cast<double>(site * site) : std::numeric_limits<double>::quiet_NaN();
  dual[0] = 1;
  warp_adjoint<2, double>({{&image, dual.data()}}, lattice, u.data(), u_dual.data());
  EXPECT_GT(u_dual[0], 0);
  for (std::size_t i = 2; i < u_dual.size(); ++i) EXPECT_EQ(u_dual[i], 0) << i;

  std::vector<double> out(lattice.sites()), slopes(u.size());
  warp<2, double>(image, lattice, u.data(), out.data(), slopes.data());
  ASSERT_TRUE(std::isnan(slopes[2 * 4]));
  warp_adjoint<2, double>(dual.data(), slopes.data(), lattice, nullptr, u_dual.data());
  EXPECT_GT(u_dual[0], 0);
  for (std::size_t i = 2; i < u_dual.size(); ++i) EXPECT_EQ(u_dual[i], 0) << i;
}

// In single precision, where corners are fetched two at a time. Oracle: double, of the same numbers; the row that ends
// with the image's last sample is among them.
template <int Dim>
void expect_the_same_in_single_precision(const Lattice<Dim>& lattice) {
  const FramedImage<Dim, double> image = plain_image(lattice, random_values(lattice.sites(), 1));
  const FramedImage<Dim, float> single =
      plain_image(lattice, std::vector<float>(image.samples.begin(), image.samples.end()));
  const std::vector<double> some = random_values(Dim * lattice.sites(), 2, 1.5),
                            many = random_values(lattice.sites(), 3);
  const std::vector<float> u_single(some.begin(), some.end()), dual_single(many.begin(), many.end());
  const std::vector<double> u(u_single.begin(), u_single.end());
  std::vector<double> out(lattice.sites()), slopes(u.size()), dual(u.size());
  std::vector<float> out_single(lattice.sites()), slopes_single(u.size()), found(u.size());
  warp<Dim, double>(image, lattice, u.data(), out.data(), slopes.data());
  warp<Dim, float>(single, lattice, u_single.data(), out_single.data(), slopes_single.data());
  for (std::size_t i = 0; i < out.size(); ++i) ASSERT_NEAR(out_single[i], out[i], 1e-4) << i;
  for (std::size_t i = 0; i < slopes.size(); ++i) ASSERT_NEAR(slopes_single[i], slopes[i], 1e-4) << i;
  warp_adjoint<Dim, double>(many.data(), slopes.data(), lattice, nullptr, dual.data());
  warp_adjoint<Dim, float>(dual_single.data(), slopes_single.data(), lattice, nullptr, found.data());
  for (std::size_t i = 0; i < dual.size(); ++i) ASSERT_NEAR(found[i], dual[i], 1e-4) << i;
}

// With one sample along x nothing beside it is looked at: it would be the next row, which may not be a number.
TEST(Warp, DoesNotReadTheNextRowOfALineOfSamples) {
  const Lattice<2> lattice{{1, 5}, {1, 1}, {}};
  FramedImage<2, float> image = plain_image(lattice, std::vector<float>{0, 1, 2, 3, 4});
  image.samples[3] = std::numeric_limits<float>::quiet_NaN();
  const std::vector<float> u = {0, 0.5f, 0, 0.5f, 0, 0, 0, 0, 0, 0};
  std::vector<float> out(5), slopes(10);
  warp<2, float>(image, lattice, u.data(), out.data(), slopes.data());
  EXPECT_EQ(out[1], 1.5f);
  EXPECT_EQ(slopes[2], 0);
  EXPECT_EQ(slopes[3], 1);
}

TEST(Warp, DoesInSinglePrecisionWhatItDoesInDouble) {
  for (int width : {1, 2, 17, 50}) {
    SCOPED_TRACE(width);
    expect_the_same_in_single_precision<2>({{width, 5}, {1, 1}, {}});
    expect_the_same_in_single_precision<3>({{width, 3, 4}, {1, 1, 1}, {}});
  }
}

}  // namespace
}  // namespace saltus
