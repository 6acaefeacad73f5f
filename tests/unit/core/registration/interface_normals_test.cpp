#include "core/registration/interface_normals.h"

#include "core/grid/image_grid.h"

#include <gtest/gtest.h>

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace saltus {
namespace {

// A smooth step across a tilted plane.
template <int Dim>
void expect_the_normal_of_a_step(const Vector<Dim>& normal, bool is_oblique, bool leaves_out) {
  Lattice<Dim> lattice;
  lattice.size.fill(Dim == 2 ? 40 : 24);
  const double spacing[3] = {1.0, 1.5, 2.0};
  for (int a = 0; a < Dim; ++a) lattice.spacing[a] = spacing[a];
  Vector<Dim> middle, jump = Vector<Dim>::Unit(0);
  for (int a = 0; a < Dim; ++a) middle[a] = (lattice.size[a] - 1) * lattice.spacing[a] / 2;
  jump -= jump.dot(normal) * normal;
  Field<double> velocity(Dim * lattice.sites());
  const auto distance = [&](const Index<Dim>& index) {
    double sum = 0;
    for (int a = 0; a < Dim; ++a) sum += normal[a] * (index[a] * lattice.spacing[a] - middle[a]);
    return sum;
  };
  for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab)
    visit_slab<Dim>(lattice, slab, [&](const Index<Dim>& index, std::size_t site) {
      for (int c = 0; c < Dim; ++c) velocity[Dim * site + c] = std::tanh(distance(index) / 2) * jump[c];
    });
  auto found = InterfaceNormals<Dim, double>(lattice, velocity).on(lattice, true);
  std::vector<double>& normals = found.values;
  EXPECT_NEAR(found.oblique_share, is_oblique ? 1 : 0, 0.1);
  if (leaves_out) InterfaceNormals<Dim, double>::leave_out_axes(normals);
  const bool is_found = is_oblique || !leaves_out;
  const std::vector<double>& strengths = found.strengths;
  ASSERT_EQ(strengths.size(), lattice.sites());
  EXPECT_EQ(*std::max_element(strengths.begin(), strengths.end()), 1);
  int near = 0, far = 0;
  for (int slab = 0; slab < lattice.size[Dim - 1]; ++slab)
    visit_slab<Dim>(lattice, slab, [&](const Index<Dim>& index, std::size_t site) {
      bool is_inside = true;  // the border's neighbourhood is cut
      for (int a = 0; a < Dim; ++a) is_inside = is_inside && index[a] >= 8 && index[a] < lattice.size[a] - 8;
      if (!is_inside) return;
      const auto n = Eigen::Map<const Vector<Dim>>(normals.data() + Dim * site);
      if (std::abs(distance(index)) < 2) {
        ++near;
        EXPECT_NEAR(std::abs(n.dot(normal)), is_found ? 1 : 0, 1e-2);
        EXPECT_GT(strengths[site], 0.7);
      }
      if (std::abs(distance(index)) > 12) {
        ++far;
        EXPECT_EQ(n.norm(), 0);
        EXPECT_EQ(strengths[site], 0);
      }
    });
  EXPECT_GT(near, 10);
  EXPECT_TRUE(Dim == 3 || far > 10);
}

TEST(InterfaceNormals, AreThoseOfAStep) {
  for (double degrees : {20.0, 45.0, 100.0}) {
    const double angle = degrees * std::numbers::pi / 180;
    for (bool leaves_out : {true, false})
      expect_the_normal_of_a_step<2>({std::cos(angle), std::sin(angle)}, true, leaves_out);
  }
  expect_the_normal_of_a_step<3>(Vector<3>(1, 2, -2) / 3, true, true);
  expect_the_normal_of_a_step<2>({0, 1}, false, false);
}

// Of two steps the one that is half as high stands out as much from what is around it, and both do so up to the border.
TEST(InterfaceNormals, StandOutFromWhatIsAroundThem) {
  const Lattice<2> lattice{{64, 32}, {1, 1}, {}};
  Field<double> velocity(2 * lattice.sites());
  for (int y = 0; y < 32; ++y)
    for (int x = 0; x < 64; ++x)
      velocity[2 * static_cast<std::size_t>(64 * y + x) + 1] =
          std::tanh((x - 16) / 2.0) + 0.5 * std::tanh((x - 47) / 2.0);
  const std::vector<double> strengths = InterfaceNormals<2, double>(lattice, velocity).on(lattice, true).strengths;
  for (int y = 0; y < 32; ++y) {
    const double* row = strengths.data() + 64 * y;
    EXPECT_NEAR(row[16], 1, 1e-9) << y;
    EXPECT_NEAR(row[47], 1, 1e-9) << y;
    EXPECT_LT(row[13], 0.9) << y;
    EXPECT_LT(row[44], 0.9) << y;
    EXPECT_EQ(row[32], 0) << y;
  }
}

TEST(InterfaceNormals, LeaveTheAxesToThemselves) {
  expect_the_normal_of_a_step<2>({0, 1}, false, true);
  expect_the_normal_of_a_step<3>({0, 0, 1}, false, true);
}

TEST(InterfaceNormals, AreNoneWhereNothingMoves) {
  const Lattice<2> lattice{{9, 9}, {1, 1}, {}};
  const Field<float> still(2 * lattice.sites(), 0.5f);
  const auto found = InterfaceNormals<2, float>(lattice, still).on(lattice, true);
  for (float value : found.values) EXPECT_EQ(value, 0);
  for (float value : found.strengths) EXPECT_EQ(value, 0);
  EXPECT_EQ(found.oblique_share, 0);
}

}  // namespace
}  // namespace saltus
