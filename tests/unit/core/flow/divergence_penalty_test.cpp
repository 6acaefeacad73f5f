#include "core/flow/divergence_penalty.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "tests/support/finite_differences.h"
#include "tests/support/random_fields.h"

namespace saltus {
namespace {

using testing::dot;
using testing::random_values;

template <int Dim>
Lattice<Dim> lattice() {
  if constexpr (Dim == 2)
    return {{9, 8}, {1, 1.5}, {}};
  else
    return {{6, 5, 7}, {1, 1.5, 2}, {}};
}

template <int Dim, class Velocity>
std::vector<double> sampled(const Lattice<Dim>& where, Velocity&& velocity) {
  std::vector<double> field(Dim * where.sites());
  for (int slab = 0; slab < where.size[Dim - 1]; ++slab)
    visit_slab<Dim>(where, slab, [&](const Index<Dim>& i, std::size_t site) {
      Vector<Dim> x;
      for (int c = 0; c < Dim; ++c) x[c] = i[c] * where.spacing[c];
      const Vector<Dim> v = velocity(x);
      for (int c = 0; c < Dim; ++c) field[Dim * site + c] = v[c];
    });
  return field;
}

template <int Dim>
double energy(const Lattice<Dim>& where, const std::vector<double>& v, double factor = 1) {
  std::vector<double> ignored(v.size(), 0.0);
  return add_divergence_penalty<Dim, double>(where, v.data(), factor, ignored.data());
}

// Oracle: central differences, exact for a quadratic.
template <int Dim>
void expect_gradient(const Lattice<Dim>& where = lattice<Dim>()) {
  const std::vector<double> v = random_values(Dim * where.sites(), 1), along = random_values(v.size(), 2);
  std::vector<double> dual(v.size(), 3.0);
  const double value = add_divergence_penalty<Dim, double>(where, v.data(), 0.7, dual.data());
  for (double& d : dual) d -= 3.0;  // it adds
  const double slope = testing::slope_along([&](const auto& at) { return energy(where, at, 0.7); }, v, along, 0.5);
  EXPECT_NEAR(dot(dual, along), slope, 1e-11 * value);
  EXPECT_NEAR(0.5 * dot(dual, v), value, 1e-12 * value);
}

TEST(DivergencePenalty, HasTheGradientOfItsValue) {
  expect_gradient<2>();
  expect_gradient<3>();
  for (int axis = 0; axis < 3; ++axis) {  // one sample along it
    Lattice<3> flat = lattice<3>();
    flat.size[axis] = 1;
    expect_gradient<3>(flat);
  }
}

// Oracle: closed form, the divergence of a linear field is its trace.
TEST(DivergencePenalty, IntegratesTheSquaredTrace) {
  const Lattice<3> where = lattice<3>();
  const auto v = sampled<3>(
      where, [](const Vector<3>& x) { return Vector<3>(0.3 * x[0] + x[2], -0.1 * x[1], 0.4 * x[2] - x[0]); });
  const double cells = 5 * 4 * 6 * where.cell_volume();
  EXPECT_NEAR(energy(where, v, 2.0), 0.5 * 2.0 * 0.6 * 0.6 * cells, 1e-10 * cells);
}

TEST(DivergencePenalty, IsZeroForRigidMotionAndForSlipAlongAnAxisPlane) {
  const Lattice<2> flat = lattice<2>();
  const Lattice<3> deep = lattice<3>();
  EXPECT_NEAR(energy(flat, sampled<2>(flat, [](const Vector<2>&) { return Vector<2>(1.2, -3); })), 0, 1e-24);
  EXPECT_NEAR(energy(flat, sampled<2>(flat, [](const Vector<2>& x) { return Vector<2>(-x[1], x[0]); })), 0, 1e-24);
  const Vector<3> axis(0.3, -1, 0.6);
  EXPECT_NEAR(energy(deep, sampled<3>(deep, [&](const Vector<3>& x) { return Vector<3>(axis.cross(x) + axis); })), 0,
              1e-23);
  EXPECT_EQ(energy(flat, sampled<2>(flat, [](const Vector<2>& x) { return Vector<2>(x[1] > 5 ? 4.0 : -4.0, 0); })), 0);
  EXPECT_NEAR(
      energy(deep,
             sampled<3>(deep, [](const Vector<3>& x) { return Vector<3>(0, x[0] > 2.5 ? 4.0 : -4.0, x[0] > 2.5); })),
      0, 1e-24);
  // The same jump across the plane, opening it, does cost.
  EXPECT_GT(energy(flat, sampled<2>(flat, [](const Vector<2>& x) { return Vector<2>(0, x[1] > 5 ? 4.0 : -4.0); })), 10);
}

TEST(DivergencePenalty, TakesAnAxisOfOneSample) {
  const Lattice<3> slice{{6, 5, 1}, {1, 1.5, 7}, {}};
  const auto v = sampled<3>(slice, [](const Vector<3>& x) { return Vector<3>(0.5 * x[0], 0, 9); });
  EXPECT_NEAR(energy(slice, v), 0.5 * 0.25 * 5 * 4 * slice.cell_volume(), 1e-10);
}

}  // namespace
}  // namespace saltus
