#include "server/worker/report/landmark_marks.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <regex>

namespace saltus::report {
namespace {

using drawing::choose_planes;
using drawing::planes_through;
using drawing::SlicePlane;

/// What a report needs to know for this: grids, a displacement that is the same everywhere, landmarks.
template <int Dim>
struct Scene {
  RegistrationInput<Dim> input;
  RegistrationResult<Dim> result;
  ReportInput<Dim> report;

  Scene(const Index<Dim>& size, const Vector<Dim>& spacing, const Vector<Dim>& u) {
    input.fixed.grid.size = size;
    input.fixed.grid.spacing = spacing;
    input.moving.grid = input.fixed.grid;
    result.displacement = VectorVolume<Dim>(input.fixed.grid);
    for (int c = 0; c < Dim; ++c)
      std::fill_n(result.displacement.component(c), input.fixed.grid.voxels(), static_cast<float>(u[c]));
    report.input = &input;
    report.result = &result;
  }
};

struct Circle {
  Vector<2> middle;
  bool is_dot;
};

std::vector<Circle> circles(const std::string& svg) {
  std::vector<Circle> found;
  const std::regex circle("<circle( class=\"dot\")? cx=\"([-0-9.]+)\" cy=\"([-0-9.]+)\"");
  for (std::sregex_iterator at(svg.begin(), svg.end(), circle), end; at != end; ++at)
    found.push_back({{std::stod((*at)[2]), std::stod((*at)[3])}, (*at)[1].matched});
  return found;
}

TEST(LandmarkMarks, StandWhereLandmarksAreAndWhereTheyAreCarried) {
  // Pixels of 2 mm: the picture has as many pixels as the image, and a voxel's middle lies half a pixel in.
  Scene<2> scene({40, 30}, {2, 2}, {6, -4});
  scene.report.fixed_points = {{20, 30}};
  scene.report.moving_points = {{30, 24}};
  const SlicePlane<2> plane = choose_planes(scene.result.displacement).front();
  const auto fixed = circles(fixed_landmark_marks(scene.report, plane).svg);
  ASSERT_EQ(fixed.size(), 1u);
  EXPECT_LT((fixed[0].middle - Vector<2>(10.5, 15.5)).norm(), 0.1);

  const LandmarkMarks marks = carried_landmark_marks(scene.report, plane, 10);
  EXPECT_EQ(marks.shown, 1u);
  const auto carried = circles(marks.svg);
  ASSERT_EQ(carried.size(), 2u);
  for (const Circle& one : carried)
    EXPECT_LT((one.middle - (one.is_dot ? Vector<2>(13.5, 13.5) : Vector<2>(15.5, 12.5))).norm(), 0.1);
  EXPECT_THAT(marks.svg, testing::HasSubstr("M15.5 12.5L13.5 13.5"));
}

TEST(LandmarkMarks, GoBackThroughTheAffineStart) {
  // The start carries fixed x to moving x + 10; the displacement contains it.
  Scene<2> scene({40, 30}, {1, 1}, {10, 0});
  scene.input.start.offset = {10, 0};
  scene.report.fixed_points = {{5, 5}};
  scene.report.moving_points = {{15, 5}};
  const SlicePlane<2> plane = choose_planes(scene.result.displacement).front();
  for (const Circle& one : circles(carried_landmark_marks(scene.report, plane, 1).svg))
    EXPECT_LT((one.middle - Vector<2>(5.5, 5.5)).norm(), 0.1);
}

TEST(LandmarkMarks, OfAVolumeAreThoseNearTheSlice) {
  Scene<3> scene({40, 40, 20}, {1, 1, 5}, {0, 0, 0});
  // A twentieth of 100 mm along z, of 40 mm along x and y.
  scene.report.fixed_points = {{20, 20, 50}, {21, 20, 54}, {20, 20, 60}, {30, 20, 50}};
  scene.report.moving_points = scene.report.fixed_points;
  const auto planes = planes_through<3>({20, 20, 10}, scene.input.fixed.grid);
  EXPECT_NEAR(landmark_reach_mm(scene.input.fixed.grid, planes[0]), 5, 1e-9);
  EXPECT_NEAR(landmark_reach_mm(scene.input.fixed.grid, planes[1]), 2, 1e-9);
  EXPECT_EQ(fixed_landmark_marks(scene.report, planes[0]).shown, 3u);
  EXPECT_EQ(fixed_landmark_marks(scene.report, planes[1]).shown, 4u);
  EXPECT_EQ(carried_landmark_marks(scene.report, planes[2], 1).shown, 3u);
}

}  // namespace
}  // namespace saltus::report
