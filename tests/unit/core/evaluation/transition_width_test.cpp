// Oracle: profiles whose 10-90 % width is known in closed form.
#include "core/evaluation/transition_width.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/support/errors.h"
#include "tests/unit/core/evaluation/fields.h"

namespace saltus {
namespace {

constexpr double kReach = 12;

ImageGrid<2> plane(double spacing) {
  ImageGrid<2> grid;
  grid.size = {static_cast<int>(48 / spacing) + 1, static_cast<int>(48 / spacing) + 1};
  grid.spacing = {spacing, spacing};
  grid.origin = {-24, -24};
  return grid;
}

/// Points of a straight interface through the origin whose normal is `degrees` from y.
std::vector<InterfacePoint<2>> line(double degrees) {
  const double angle = degrees * 3.14159265358979323846 / 180;
  std::vector<InterfacePoint<2>> points;
  for (double s = -6; s <= 6; s += 0.37) {
    InterfacePoint<2> point;
    point.tangent = {std::cos(angle), std::sin(angle)};
    point.normal = {-std::sin(angle), std::cos(angle)};
    point.position = s * point.tangent;
    points.push_back(point);
  }
  return points;
}

/// u = tangent * profile(distance) plus an amount along the normal that no tangential profile may see.
template <class Shape>
VectorVolume<2> field(double spacing, double degrees, Shape&& profile) {
  const InterfacePoint<2> at = line(degrees).front();
  return make_field<2>(plane(spacing), [&](const Vector<2>& x) -> Vector<2> {
    return profile(x.dot(at.normal)) * at.tangent + 0.2 * x[0] * at.normal;
  });
}

TEST(TransitionWidth, OfALinearRampIsFourFifthsOfIt) {
  for (double ramp : {2.0, 5.0, 8.0}) {
    const auto u = field(0.5, 0, [&](double r) { return 3 * std::clamp(2 * r / ramp, -1.0, 1.0); });
    const TransitionWidth found = transition_width(u, line(0), kReach);
    EXPECT_NEAR(found.width_mm, 0.8 * ramp, 1e-3) << ramp;
    EXPECT_NEAR(found.jump_mm, 6, 1e-5);
    EXPECT_EQ(found.points, line(0).size());
    EXPECT_EQ(found.resolved, found.points);
  }
}

// tanh(r / a) reaches 80 % at a artanh(0.8) = a ln(9) / 2. Linear interpolation rounds it off by (h / a)^2 at most.
TEST(TransitionWidth, OfAHyperbolicTangentAtAnyAngle) {
  for (double degrees : {0.0, 30.0, 45.0})
    for (double a : {1.5, 2.5}) {
      const auto u = field(0.25, degrees, [&](double r) { return -1 + 2 * std::tanh(r / a); });
      const TransitionWidth found = transition_width(u, line(degrees), kReach);
      EXPECT_NEAR(found.width_mm, a * std::log(9.0), 0.03) << degrees << " " << a;
      EXPECT_NEAR(found.jump_mm, 4, 0.01);
    }
}

// The interface lies between two rows of samples: the field rises within one spacing and cannot rise faster.
TEST(TransitionWidth, OfAJumpBetweenTwoSamplesIsFourFifthsOfTheSpacing) {
  for (double spacing : {0.5, 1.0, 2.0}) {
    const auto u = field(spacing, 0, [&](double r) { return r > 0.5 * spacing ? 5.0 : -1.0; });
    const TransitionWidth found = transition_width(u, line(0), kReach);
    EXPECT_NEAR(found.width_mm, 0.8 * spacing, 1e-3) << spacing;
    EXPECT_NEAR(found.jump_mm, 6, 1e-5);
  }
  // Off the axes a cell's diagonal is the most that linear interpolation can add.
  const auto oblique = field(1, 45, [](double r) { return r > 0 ? 3.0 : -3.0; });
  const double width = transition_width(oblique, line(45), kReach).width_mm;
  EXPECT_GT(width, 0.2);
  EXPECT_LT(width, std::sqrt(2.0));
}

// A slope on both sides moves the levels, not the width of a jump that towers over it.
TEST(TransitionWidth, LooksAtTheJumpNextToTheInterface) {
  const auto u = field(1, 0, [](double r) { return 0.05 * r + (r > 0.5 ? 3.0 : -3.0); });
  const TransitionWidth found = transition_width(u, line(0), kReach);
  EXPECT_NEAR(found.width_mm, 0.8, 0.15);
  EXPECT_NEAR(found.jump_mm, 7, 0.05);  // 6 plus twice 0.05 * 10
}

TEST(TransitionWidth, CountsPointsThatShowNoJump) {
  const TransitionWidth flat = transition_width(field(1, 0, [](double) { return 2.0; }), line(0), kReach);
  EXPECT_EQ(flat.points, line(0).size());
  EXPECT_EQ(flat.resolved, 0u);
  EXPECT_EQ(flat.width_mm, 0);
  EXPECT_NEAR(flat.jump_mm, 0, 1e-6);
  const auto against = field(1, 0, [](double r) { return r > 0.5 ? -3.0 : 3.0; });
  EXPECT_EQ(transition_width(against, line(0), kReach).resolved, 0u);
  EXPECT_NEAR(transition_width(against, line(0), kReach).jump_mm, -6, 1e-5);
}

TEST(TransitionWidth, LeavesOutLinesThatLeaveTheField) {
  const auto u = field(1, 0, [](double r) { return r > 0.5 ? 3.0 : -3.0; });
  auto points = line(0);
  points.front().position[1] = 20;
  EXPECT_EQ(transition_width(u, points, kReach).points, points.size() - 1);
  EXPECT_THROW(transition_width(u, points, 0), InvalidInput);
  EXPECT_THROW(transition_width(u, points, std::nan("")), InvalidInput);
}

// Oracle: the normal part is given.
TEST(NormalJump, TellsOpeningFromClosing) {
  const auto normal_part = [](double above) {
    return make_field<2>(plane(1), [&](const Vector<2>& x) { return Vector<2>(7, x[1] > 0.5 ? above : 0.0); });
  };
  const VectorVolume<2> truth = normal_part(0.25);
  EXPECT_NEAR(normal_jump(normal_part(1.75), truth, line(0), 2).opening_mm, 1.5, 1e-6);
  EXPECT_EQ(normal_jump(normal_part(1.75), truth, line(0), 2).closing_mm, 0);
  EXPECT_NEAR(normal_jump(normal_part(-0.75), truth, line(0), 2).closing_mm, 1, 1e-6);
  EXPECT_EQ(normal_jump(normal_part(-0.75), truth, line(0), 2).opening_mm, 0);
  EXPECT_EQ(normal_jump(truth, truth, line(0), 2).points, line(0).size());
  EXPECT_THROW(normal_jump(truth, VectorVolume<2>(plane(2)), line(0), 2), InvalidInput);
  EXPECT_THROW(normal_jump(truth, truth, line(0), -1), InvalidInput);
}

}  // namespace
}  // namespace saltus
