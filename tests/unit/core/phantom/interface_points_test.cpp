// Oracle: lines, circles and the motion beside them in closed form.
#include "core/phantom/interface_points.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/phantom/make_phantom.h"
#include "tests/unit/core/phantom/scene_cases.h"

namespace saltus {
namespace {

template <int Dim>
void expect_points_on_the_interface() {
  for (const auto& [name, options] : scene_cases<Dim>()) {
    SCOPED_TRACE(name);
    const auto scene = make_scene<Dim>(options);
    const auto points = interface_points<Dim>(*scene, phantom_grid<Dim>(options));
    if (options.kind == PhantomKind::Smooth) {
      EXPECT_TRUE(points.empty());
      continue;
    }
    EXPECT_GT(points.size(), 20u);
    for (const InterfacePoint<Dim>& point : points) {
      EXPECT_NEAR(point.normal.norm(), 1, 1e-12);
      EXPECT_NEAR(point.tangent.norm(), 1, 1e-12);
      EXPECT_NEAR(point.normal.dot(point.tangent), 0, 1e-9);
      // The thorax says its distance to first order only.
      EXPECT_NEAR(scene->interface_distance(point.position), 0, options.kind == PhantomKind::Thorax ? 0.3 : 1e-5);
    }
  }
}

TEST(InterfacePoints, LieOnTheInterface2D) { expect_points_on_the_interface<2>(); }
TEST(InterfacePoints, LieOnTheInterface3D) { expect_points_on_the_interface<3>(); }

TEST(InterfacePoints, PointTheTangentAlongTheJump) {
  PhantomOptions options = default_phantom_options(PhantomKind::Slip);
  options.angle_deg = 30;
  const double c = std::cos(3.14159265358979323846 / 6), s = 0.5;
  for (const auto& point : interface_points<2>(*make_scene<2>(options), phantom_grid<2>(options))) {
    EXPECT_LT((point.normal - Vector<2>(-s, c)).norm(), 1e-6);
    EXPECT_LT((point.tangent - Vector<2>(c, s)).norm(), 1e-6);
  }
  // About a circle the outer side turns clockwise: psi = R(-a) on the outside.
  options.interface = InterfaceShape::Circle;
  const Vector<2> centre(63.5, 63.5);
  for (const auto& point : interface_points<2>(*make_scene<2>(options), phantom_grid<2>(options))) {
    const Vector<2> out = (point.position - centre).normalized();
    EXPECT_LT((point.normal - out).norm(), 1e-4);
    EXPECT_LT((point.tangent - Vector<2>(out[1], -out[0])).norm(), 1e-3);
  }
}

}  // namespace
}  // namespace saltus
