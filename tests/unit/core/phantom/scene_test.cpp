#include "core/phantom/scene.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>

#include "core/support/errors.h"
#include "core/support/random.h"
#include "tests/unit/core/phantom/scene_cases.h"

namespace saltus {
namespace {

template <int Dim>
std::vector<Vector<Dim>> random_points(const ImageGrid<Dim>& grid, int count) {
  RandomSequence random(4711, 1);
  std::vector<Vector<Dim>> points;
  for (int i = 0; i < count; ++i) {
    Vector<Dim> index;
    for (int axis = 0; axis < Dim; ++axis) index[axis] = random.uniform(0, grid.size[axis] - 1);
    points.push_back(grid.to_world(index));
  }
  return points;
}

template <int Dim>
void expect_map_and_inverse_agree() {
  for (const auto& [name, options] : scene_cases<Dim>()) {
    SCOPED_TRACE(name);
    const auto scene = make_scene<Dim>(options);
    for (const Vector<Dim>& x : random_points(phantom_grid<Dim>(options), 3000)) {
      // A point within rounding of the interface may be put on either side.
      if (std::abs(scene->interface_distance(x)) < 1e-6) continue;
      EXPECT_LT((scene->to_fixed(scene->to_moving(x)) - x).norm(), 1e-9) << x.transpose();
      EXPECT_LT((scene->to_moving(scene->to_fixed(x)) - x).norm(), 1e-9) << x.transpose();
    }
  }
}

TEST(Scene, MapAndInverseAgree2D) { expect_map_and_inverse_agree<2>(); }
TEST(Scene, MapAndInverseAgree3D) { expect_map_and_inverse_agree<3>(); }

// Without density change the fixed image is the moving image at the mapped point, on both sides of the interface.
template <int Dim>
void expect_fixed_is_moving_at_mapped_point() {
  for (const auto& [name, options] : scene_cases<Dim>()) {
    if (options.kind == PhantomKind::Thorax) continue;
    SCOPED_TRACE(name);
    const auto scene = make_scene<Dim>(options);
    int inner = 0, outer = 0;
    for (const Vector<Dim>& x : random_points(phantom_grid<Dim>(options), 3000)) {
      EXPECT_NEAR(scene->fixed(x), scene->moving(scene->to_moving(x)), 1e-9);
      ++(scene->interface_distance(x) < 0 ? inner : outer);
    }
    if (options.kind != PhantomKind::Smooth) {
      EXPECT_GT(inner, 300);
    }
    EXPECT_GT(outer, 300);
  }
}

TEST(Scene, FixedIsMovingAtMappedPoint2D) { expect_fixed_is_moving_at_mapped_point<2>(); }
TEST(Scene, FixedIsMovingAtMappedPoint3D) { expect_fixed_is_moving_at_mapped_point<3>(); }

// Oracle: central differences of the map, off the interface.
template <int Dim>
void expect_jacobian_equals_differences() {
  constexpr double kStep = 1e-4;
  for (const auto& [name, options] : scene_cases<Dim>()) {
    SCOPED_TRACE(name);
    const auto scene = make_scene<Dim>(options);
    for (const Vector<Dim>& x : random_points(phantom_grid<Dim>(options), 1000)) {
      if (std::abs(scene->interface_distance(x)) < 0.1) continue;
      Matrix<Dim> gradient;
      for (int axis = 0; axis < Dim; ++axis) {
        const Vector<Dim> step = kStep * Vector<Dim>::Unit(axis);
        gradient.col(axis) = (scene->to_moving(x + step) - scene->to_moving(x - step)) / (2 * kStep);
      }
      EXPECT_NEAR(scene->jacobian(x), gradient.determinant(), 1e-5) << x.transpose();
      EXPECT_GT(scene->jacobian(x), 0.2);
    }
  }
}

TEST(Scene, JacobianEqualsDifferences2D) { expect_jacobian_equals_differences<2>(); }
TEST(Scene, JacobianEqualsDifferences3D) { expect_jacobian_equals_differences<3>(); }

// Nobody crosses the wall: the motion keeps the distance's sign and, at the interface, its value.
template <int Dim>
void expect_interface_is_kept() {
  for (const auto& [name, options] : scene_cases<Dim>()) {
    SCOPED_TRACE(name);
    const auto scene = make_scene<Dim>(options);
    for (const Vector<Dim>& x : random_points(phantom_grid<Dim>(options), 3000)) {
      const double before = scene->interface_distance(x);
      const double after = scene->interface_distance(scene->to_moving(x));
      if (std::isinf(before) || std::isinf(after) || std::abs(before) < 1e-6) continue;
      EXPECT_EQ(before < 0, after < 0);
      if (std::abs(before) < 1) {
        EXPECT_NEAR(after, before, 0.1) << x.transpose();
      }
    }
  }
}

TEST(Scene, MotionDoesNotCrossTheInterface2D) { expect_interface_is_kept<2>(); }
TEST(Scene, MotionDoesNotCrossTheInterface3D) { expect_interface_is_kept<3>(); }

TEST(Scene, RectangleMovesAsThePaperSays) {
  const auto scene = make_scene<2>(default_phantom_options(PhantomKind::Rectangle));
  // u_x = -5 on rows 0 to 39 and +5 below, interface at row 39.5.
  EXPECT_EQ(scene->to_moving({40, 39}), Vector<2>(35, 39));
  EXPECT_EQ(scene->to_moving({40, 40}), Vector<2>(45, 40));
  EXPECT_DOUBLE_EQ(scene->interface_distance({3, 39.5}), 0);
  EXPECT_TRUE(scene->is_valid({14, 0}) && scene->is_valid({65, 79}));
  EXPECT_FALSE(scene->is_valid({13, 40}) || scene->is_valid({66, 40}));
  // The template's ridge is at column 42.
  EXPECT_DOUBLE_EQ(scene->moving({42, 10}), 253);
  EXPECT_DOUBLE_EQ(scene->fixed({47, 10}), 253);
  EXPECT_DOUBLE_EQ(scene->fixed({37, 60}), 253);
}

TEST(Scene, WheelTurnsAsThePaperSays) {
  const auto scene = make_scene<2>(default_phantom_options(PhantomKind::Wheel));
  const double angle = 5 * M_PI / 180;
  // R(theta) = T(theta + 5 deg) inside radius 59 about (101, 100), T(theta - 5 deg) outside.
  const Vector<2> inside = scene->to_moving({101 + 40, 100}), outside = scene->to_moving({101 + 80, 100});
  EXPECT_LT((inside - Vector<2>(101 + 40 * std::cos(angle), 100 + 40 * std::sin(angle))).norm(), 1e-12);
  EXPECT_LT((outside - Vector<2>(101 + 80 * std::cos(angle), 100 - 80 * std::sin(angle))).norm(), 1e-12);
  EXPECT_TRUE(scene->is_valid({109, 100}) && scene->is_valid({193, 100}));
  EXPECT_FALSE(scene->is_valid({108.9, 100}) || scene->is_valid({193.1, 100}));
}

TEST(Scene, SlipHasTheAskedAmountAtTheInterface) {
  PhantomOptions options = default_phantom_options(PhantomKind::Slip);
  options.slip_mm = 7;
  options.angle_deg = 30;
  const double tiny = 1e-9;
  {
    const auto scene = make_scene<2>(options);
    const Vector<2> centre(63.5, 63.5), normal(-std::sin(M_PI / 6), std::cos(M_PI / 6));
    const Vector<2> jump = scene->to_moving(centre + tiny * normal) - scene->to_moving(centre - tiny * normal);
    EXPECT_NEAR(jump.norm(), 7, 1e-6);
    EXPECT_NEAR(jump.dot(normal), 0, 1e-6);
  }
  options.interface = InterfaceShape::Circle;
  const auto scene = make_scene<2>(options);
  auto angle_at = [&](double radius) {
    const Vector<2> p = scene->to_moving({63.5 + radius, 63.5}) - Vector<2>(63.5, 63.5);
    return std::atan2(p[1], p[0]);
  };
  // Along the arc.
  EXPECT_NEAR(36 * (angle_at(36 - tiny) - angle_at(36 + tiny)), 7, 1e-6);
}

TEST(Scene, RefusesTheWrongDimension) {
  EXPECT_THROW(make_scene<3>(default_phantom_options(PhantomKind::Slip)), InvalidInput);
  EXPECT_THROW(make_scene<2>(default_phantom_options(PhantomKind::Thorax)), InvalidInput);
}

}  // namespace
}  // namespace saltus
