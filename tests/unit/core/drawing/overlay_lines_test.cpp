#include "core/drawing/overlay_lines.h"

#include <gtest/gtest.h>

#include <regex>

namespace saltus::drawing {
namespace {

std::vector<Vector<2>> points_of(const std::string& path) {
  std::vector<Vector<2>> points;
  const std::regex point("[ML](-?[0-9.]+) (-?[0-9.]+)");
  for (std::sregex_iterator at(path.begin(), path.end(), point), end; at != end; ++at)
    points.emplace_back(std::stod((*at)[1]), std::stod((*at)[2]));
  return points;
}

VectorVolume<2> uniform(const Vector<2>& u) {
  ImageGrid<2> grid;
  grid.size = {40, 20};
  grid.spacing = {1, 2};
  VectorVolume<2> field(grid);
  for (int c = 0; c < 2; ++c) std::fill_n(field.component(c), grid.voxels(), static_cast<float>(u[c]));
  return field;
}

TEST(DeformedGridLines, IsCarriedByTheDisplacement) {
  const Vector<2> u(3, -2);
  const VectorVolume<2> still = uniform({0, 0}), moving = uniform(u);
  const SlicePlane<2> plane = choose_planes(still).front();
  const auto before = points_of(svg_path(deformed_grid_lines(still, plane))),
             after = points_of(svg_path(deformed_grid_lines(moving, plane)));
  ASSERT_EQ(before.size(), after.size());
  ASSERT_GT(before.size(), 100u);
  for (std::size_t i = 0; i < before.size(); ++i)
    EXPECT_LT((after[i] - before[i] - u / plane.pixel_mm).norm(), 0.15);  // the path has one decimal
}

TEST(ArrowLines, PointsAlongTheDisplacementAtItsScale) {
  const VectorVolume<2> field = uniform({0, 3});
  const SlicePlane<2> plane = choose_planes(field).front();
  const auto points = points_of(svg_path(arrow_lines(field, plane, 6)));
  ASSERT_GT(points.size(), 100u);
  ASSERT_EQ(points.size() % 5, 0u);
  for (std::size_t i = 0; i < points.size(); i += 5) {
    // Half of longest_mm is half of nine tenths of the distance of the arrows, a sixteenth of the longer side.
    EXPECT_LT((points[i + 1] - points[i] - Vector<2>(0, 0.45 * 40 / 16)).norm(), 0.15);
    EXPECT_EQ(points[i + 3], points[i + 1]);
  }
}

TEST(ArrowLines, LeavesOutWhatHardlyMoves) {
  const VectorVolume<2> field = uniform({0.1, 0});
  EXPECT_TRUE(arrow_lines(field, choose_planes(field).front(), 6).empty());
}

}  // namespace
}  // namespace saltus::drawing
