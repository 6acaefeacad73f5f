#include "core/drawing/line_chart.h"

#include <gtest/gtest.h>

#include <limits>

namespace saltus::drawing {
namespace {

/// The rows in a column, below the legend, that are nearly of the first curve's blue.
std::vector<int> rows_of_curve(const Raster& raster, int column) {
  std::vector<int> rows;
  for (int row = 45; row < raster.height; ++row)
    if (raster.at(column, row)[0] < 100 && raster.at(column, row)[2] > 150) rows.push_back(row);
  return rows;
}

TEST(LineChartRaster, DrawsTheCurveWhereItsValuesAre) {
  // Plot area of the 420 x 270 chart: columns 62 to 406, rows 46 to 226; y from 0 to 1.
  LineChart chart;
  chart.curves = {{"a", {{0, 0}, {1, 0}, {1, 1}, {2, 1}}}};
  const Raster raster = to_raster(chart);
  ASSERT_EQ(raster.width, 420);
  ASSERT_EQ(raster.height, 270);
  ASSERT_FALSE(rows_of_curve(raster, 120).empty());
  EXPECT_NEAR(rows_of_curve(raster, 120).front(), 226, 1);
  ASSERT_FALSE(rows_of_curve(raster, 320).empty());
  EXPECT_NEAR(rows_of_curve(raster, 320).front(), 46, 1);
  EXPECT_GT(rows_of_curve(raster, 234).size(), 150u);
}

TEST(LineChartRaster, BreaksAtWhatIsNoNumber) {
  LineChart chart;
  chart.curves = {{"a", {{0, 0}, {1, 0}, {1, std::numeric_limits<double>::quiet_NaN()}, {1, 1}, {2, 1}}}};
  EXPECT_LT(rows_of_curve(to_raster(chart), 234).size(), 8u);
}

TEST(LineChartRaster, IsAsLargeAsAsked) {
  LineChart chart;
  chart.curves = {{"a", {{0, 0}, {1, 1}}}};
  EXPECT_EQ(to_raster(chart, 2).width, 840);
  EXPECT_EQ(to_raster(chart, 2).height, 540);
}

}  // namespace
}  // namespace saltus::drawing
