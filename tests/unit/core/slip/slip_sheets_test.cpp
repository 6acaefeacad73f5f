// Points followed beside a surface that no axis is along. Oracle: the velocity of a straight sheet in closed form,
// which is linear on either side, and constant along each point's path since the sheet slides along itself.
#include "core/slip/slip_sheets.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/flow/discontinuous/transport_points.h"
#include "core/grid/interpolation.h"
#include "tests/unit/core/slip/made_sheet.h"

namespace saltus {
namespace {

using testing::MadeSheet;

/// How far points beside the sheet end from where they should, mm: followed by particles, and by the field taken
/// linearly between its samples.
struct Outcome {
  double particles = 0, field = 0;
  int count = 0;
};

template <int Dim, class Truth>
Outcome follow(const MadeSheet<Dim>& made, const Lattice<Dim>& lattice, const std::vector<Vector<Dim>>& points,
               const Truth& displacement) {
  auto sheets = slip_sheets<Dim>(made.elements(), lattice, made.velocities());
  EXPECT_FALSE(sheets.empty());
  const GriddedVelocity<Dim, float> velocity(lattice, made.velocities(), std::move(sheets));
  const auto moved = transport_points<Dim, float>(velocity, points, TransportDirection::FixedToMoving,
                                                  gridded_trajectory_options(lattice));
  const Field<float> backward = backward_map<Dim, float>(lattice, lattice, made.velocities());
  Outcome found;
  for (std::size_t i = 0; i < points.size(); ++i) {
    EXPECT_EQ(moved[i].ending, TrajectoryEnd::Complete) << points[i].transpose() << ": " << to_string(moved[i].ending);
    const Vector<Dim> truth = displacement(points[i]);
    found.particles += (moved[i].position - points[i] - truth).norm();
    std::array<float, Dim> at;
    for (int a = 0; a < Dim; ++a) at[a] = static_cast<float>((points[i][a] - lattice.offset[a]) / lattice.spacing[a]);
    const auto value = LinearCell<Dim, float>(lattice, at).template value<Dim>(backward.data());
    Vector<Dim> linear;
    for (int c = 0; c < Dim; ++c) linear[c] = value[c];
    found.field += (linear - truth).norm();
    ++found.count;
  }
  found.particles /= found.count;
  found.field /= found.count;
  return found;
}

TEST(SlipSheets, KeepPointsOnTheirSideOfAnObliqueLine) {
  for (double degrees : {20.0, 45.0, 75.0}) {
    const double angle = degrees * 3.14159265358979 / 180;
    const Vector<2> t(std::cos(angle), std::sin(angle)), n(-t[1], t[0]), middle(30, 30.2);
    const Lattice<2> lattice{{61, 61}, {1, 1}, {0, 0}};
    const MadeSheet<2> made(
        lattice, [=](const Vector<2>& x) { return n.dot(x - middle); }, [=](const Vector<2>&) { return n; },
        [=](const Vector<2>&) { return Vector<2>(4 * t); });
    std::vector<Vector<2>> points;
    for (int i = -4; i <= 4; ++i)
      for (double off : {-1.2, -0.6, -0.15, 0.15, 0.6, 1.2}) points.push_back(middle + 2.3 * i * t + off * n);
    const auto truth = [&](const Vector<2>& x) {
      const double r = n.dot(x - middle);
      return Vector<2>((r > 0 ? -2 : 2) * (1 - std::abs(r) / MadeSheet<2>::kWidth) * t);
    };
    const Outcome found = follow<2>(made, lattice, points, truth);
    EXPECT_LT(found.particles, 0.15) << degrees;
    EXPECT_GT(found.field, 0.6) << "the field mixes the sides";
  }
}

TEST(SlipSheets, KeepPointsOnTheirSideOfATiltedPlane) {
  const Vector<3> n = Vector<3>(1, 2, -1.5).normalized(), t = Vector<3>(2, -1, 0).normalized(), middle(14.3, 15, 14.8);
  const Lattice<3> lattice{{30, 30, 30}, {1, 1, 1}, {0, 0, 0}};
  const MadeSheet<3> made(
      lattice, [=](const Vector<3>& x) { return n.dot(x - middle); }, [=](const Vector<3>&) { return n; },
      [=](const Vector<3>&) { return Vector<3>(2 * t); });
  std::vector<Vector<3>> points;
  for (int i = -1; i <= 1; ++i)
    for (double off : {-0.7, -0.2, 0.2, 0.7}) points.push_back(middle + 1.3 * i * t + off * n);
  // The kernels across the plane's 9 mm are whole nowhere in so small a lattice, so the jump is not quite 2.
  const auto truth = [&](const Vector<3>& x) {
    const double r = n.dot(x - middle);
    return Vector<3>((r > 0 ? -1 : 1) * (1 - std::abs(r) / MadeSheet<3>::kWidth) * t);
  };
  const Outcome found = follow<3>(made, lattice, points, truth);
  EXPECT_LT(found.particles, 0.12);
  EXPECT_GT(found.field, 0.3);
}

TEST(SlipSheets, AreNoneWithoutElements) {
  const Lattice<2> lattice{{9, 9}, {1, 1}, {0, 0}};
  const std::vector<Field<float>> still(2, Field<float>(2 * lattice.sites(), 0.0f));
  EXPECT_TRUE(slip_sheets<2>({}, lattice, still).empty());
}

}  // namespace
}  // namespace saltus
