#include "core/momenta/directional_momentum.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "core/momenta/momentum_scale.h"
#include "tests/support/finite_differences.h"
#include "tests/support/random_fields.h"

namespace saltus {
namespace {

using testing::dot;
using testing::random_values;

/// Random unit vectors, 0 at every fourth site.
template <int Dim>
Field<double> random_directions(std::size_t sites, std::uint64_t seed) {
  Field<double> w = testing::random_field(Dim * sites, seed);
  for (std::size_t site = 0; site < sites; ++site) {
    double square = 0;
    for (int c = 0; c < Dim; ++c) square += w[Dim * site + c] * w[Dim * site + c];
    for (int c = 0; c < Dim; ++c) w[Dim * site + c] *= site % 4 == 3 ? 0 : 1 / std::sqrt(square);
  }
  return w;
}

// Oracle: <E m, f> = <m, E^T f>, with E m written out.
template <int Dim>
void expect_transpose() {
  constexpr std::size_t sites = 30;
  const Field<double> w = random_directions<Dim>(sites, 1);
  const DirectionalMomentum<Dim, double> momentum(w);
  const std::vector<double> along = random_values(Dim * sites, 2), first = random_values(Dim * Dim * sites, 3);
  std::vector<double> expanded(first.size()), contracted(along.size());
  momentum.expand(along.data(), expanded.data());
  momentum.contract(first.data(), contracted.data());
  EXPECT_NEAR(dot(expanded, first), dot(along, contracted), 1e-12);
  for (std::size_t site = 0; site < sites; ++site)
    for (int axis = 0; axis < Dim; ++axis)
      for (int c = 0; c < Dim; ++c)
        EXPECT_EQ(expanded[Dim * sites * axis + Dim * site + c], w[Dim * site + axis] * along[Dim * site + c]);
}

TEST(DirectionalMomentum, ExpandsAlongItsDirectionAndHasAnExactTranspose) {
  expect_transpose<2>();
  expect_transpose<3>();
}

TEST(DirectionalMomentum, LosesItsNormalPartAndKeepsTheRest) {
  constexpr std::size_t sites = 12;
  const Field<double> w = random_directions<3>(sites, 4);
  const DirectionalMomentum<3, double> momentum(w);
  const std::vector<double> before = random_values(3 * sites, 5);
  std::vector<double> after = before;
  momentum.drop_normal(after.data());
  for (std::size_t site = 0; site < sites; ++site) {
    const Eigen::Map<const Eigen::Vector3d> n(w.data() + 3 * site), a(before.data() + 3 * site),
        b(after.data() + 3 * site);
    EXPECT_NEAR(n.dot(b), 0, 1e-14);
    EXPECT_NEAR((a - b - n * n.dot(a)).norm(), 0, 1e-14);
  }
}

// A direction along an axis is that axis' own first order: the sheet jumps between two samples.
TEST(DirectionalMomentum, AlongAnAxisMakesTheJumpOfThatAxis) {
  const Lattice<2> where{{31, 31}, {1, 1}, {}};
  MomentumScale<2, double> scale({make_wendland_profile(7), where, Orders::First, 1.0, 0.8});
  for (int axis : {0, 1}) {
    Field<double> w(2 * where.sites(), 0.0);
    for (std::size_t site = 0; site < where.sites(); ++site) w[2 * site + axis] = 1;
    const DirectionalMomentum<2, double> momentum(w);
    const std::vector<double> along = random_values(2 * where.sites(), 6);
    std::vector<double> first(2 * along.size()), plain(2 * along.size(), 0.0), v(along.size()), expected(along.size());
    momentum.expand(along.data(), first.data());
    std::copy(along.begin(), along.end(), plain.begin() + static_cast<std::ptrdiff_t>(axis * along.size()));
    scale.synthesise(nullptr, first.data(), v.data());
    scale.synthesise(nullptr, plain.data(), expected.data());
    EXPECT_EQ(v, expected);
  }
}

TEST(NearestDirections, AreThoseOfTheImageAndNeverMixed) {
  const Lattice<2> image{{16, 16}, {1, 1}, {}}, coarse = coarsened(image, 2.0);
  ASSERT_LT(coarse.size[0], 16);
  Field<double> w(2 * image.sites(), 0.0);
  for (std::size_t site = 0; site < image.sites(); ++site) w[2 * site + site % 2] = site % 3 ? 1 : -1;
  for (double value : nearest_directions<2>(image, w, coarse)) EXPECT_TRUE(value == 0 || value == 1 || value == -1);
  EXPECT_EQ(nearest_directions<2>(image, w, image), w);
}

}  // namespace
}  // namespace saltus
