// A slip surface over a slice. Oracle: pieces whose place in the picture is known.
#include "server/worker/report/slip_marks.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace saltus::report {
namespace {

using testing::HasSubstr;
using testing::Not;

template <int Dim>
SlipPoint<Dim> piece(const Vector<Dim>& at, const Vector<Dim>& normal, double area, double jump) {
  SlipPoint<Dim> point;
  point.position = at;
  point.normal = normal;
  point.area = area;
  for (int a = 0; a < Dim && point.jump.norm() == 0; ++a)
    if (normal[a] == 0) point.jump[a] = jump;
  return point;
}

std::size_t lines_in(const std::string& svg) {
  return static_cast<std::size_t>(std::count(svg.begin(), svg.end(), 'L'));
}

TEST(SlipMarks, AreLinesAcrossTheNormal) {
  ImageGrid<2> grid;
  grid.size = {20, 20};
  const auto plane = drawing::planes_through<2>(Vector<2>(10, 10), grid, 200).front();
  const SlipSurface<2> surface{{piece<2>({5, 8}, {0, 1}, 2, 3)}, 0.1};
  const Vector<2> from = plane.picture_point(Vector<2>(4, 8), grid), to = plane.picture_point(Vector<2>(6, 8), grid);
  char one[64], other[64];
  std::snprintf(one, sizeof one, "M%.1f %.1fL%.1f %.1f", from[0], from[1], to[0], to[1]);
  std::snprintf(other, sizeof other, "M%.1f %.1fL%.1f %.1f", to[0], to[1], from[0], from[1]);
  EXPECT_THAT(slip_marks(surface, grid, plane, 4), testing::AnyOf(HasSubstr(one), HasSubstr(other)));
}

TEST(SlipMarks, AreThoseWithinHalfASlice) {
  ImageGrid<3> grid;
  grid.size = {20, 20, 20};
  SlipSurface<3> surface;
  for (double z : {7.4, 7.6, 8.4, 8.6}) surface.points.push_back(piece<3>({5, 8, z}, {0, 1, 0}, 1, 3));
  surface.points.push_back(piece<3>({5, 8, 8}, {0, 0, 1}, 1, 3));
  for (const auto& plane : drawing::planes_through<3>(Vector<3>(5, 8, 8), grid, 200)) {
    const std::string svg = slip_marks(surface, grid, plane, 4);
    if (plane.slice_axis == 2) {
      EXPECT_EQ(lines_in(svg), 2u) << svg;
      EXPECT_THAT(svg, HasSubstr("class=\"face\""));
    }
    // All lie in the slice across y, where those with that normal are squares; the last one is cut.
    if (plane.slice_axis == 1) {
      EXPECT_EQ(lines_in(svg), 1u) << svg;
    }
  }
}

TEST(StrongestSlip, IsWhereMostOfItIs) {
  ImageGrid<2> grid;
  grid.size = {40, 40};
  grid.spacing = {0.5, 0.5};
  SlipSurface<2> surface;
  surface.points.push_back(piece<2>({2, 2}, {0, 1}, 1, 5));  // alone
  for (int i = 0; i < 5; ++i) surface.points.push_back(piece<2>({12 + 0.5 * i, 15}, {0, 1}, 1, 3));
  const auto found = strongest_slip(surface, grid);
  ASSERT_TRUE(found);
  EXPECT_EQ((*found)[1], 30);
  EXPECT_NEAR((*found)[0], 26, 3);
  EXPECT_FALSE(strongest_slip(SlipSurface<2>{}, grid));
}

}  // namespace
}  // namespace saltus::report
