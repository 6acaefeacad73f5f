#include "tests/benchmark/scatter_plot.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <regex>
#include <stdexcept>

#include "tests/support/random_fields.h"

namespace saltus::benchmark {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

bool holds(const Box& frame, const Box& box) {
  return box.left >= frame.left && box.top >= frame.top && box.left + box.width <= frame.left + frame.width &&
         box.top + box.height <= frame.top + frame.height;
}

// Oracle: the boxes themselves.
TEST(PlaceLabels, KeepsThemApartAndInTheFrameWhereverThePointsAre) {
  const Box frame{40, 30, 250, 170};
  for (std::uint64_t seed = 1; seed < 60; ++seed) {
    SCOPED_TRACE(seed);
    const std::vector<double> random = testing::random_values(16, seed);
    std::vector<std::pair<double, double>> points, sizes;
    for (std::size_t k = 0; k < 8; ++k) {
      // From all over the panel to all in one corner of it.
      const double spread = seed % 3 == 0 ? 1 : seed % 3 == 1 ? 0.3 : 0.05;
      points.emplace_back(frame.left + frame.width * (0.5 + 0.49 * (1 - spread) + 0.49 * spread * random[2 * k]),
                          frame.top + frame.height * (0.5 + 0.49 * (1 - spread) + 0.49 * spread * random[2 * k + 1]));
      sizes.emplace_back(30 + 5 * k, 12);
    }
    const std::vector<Box> boxes = place_labels(points, sizes, frame);
    ASSERT_EQ(boxes.size(), points.size());
    for (std::size_t k = 0; k < boxes.size(); ++k) {
      EXPECT_TRUE(holds(frame, boxes[k])) << k;
      EXPECT_EQ(boxes[k].width, sizes[k].first);
      for (std::size_t other = 0; other < boxes.size(); ++other) {
        if (other < k) {
          EXPECT_FALSE(boxes[k].overlaps(boxes[other])) << k << " " << other;
        }
        EXPECT_FALSE(boxes[k].overlaps({points[other].first, points[other].second, 0.1, 0.1})) << k << " " << other;
      }
    }
  }
}

TEST(PlaceLabels, StandsRightOfAPointThatHasRoom) {
  const std::vector<Box> boxes = place_labels({{100, 100}}, {{40, 12}}, {0, 0, 300, 300});
  EXPECT_GT(boxes[0].left, 100);
  EXPECT_LT(boxes[0].left, 110);
  EXPECT_NEAR(boxes[0].top + 6, 100, 1);
}

TEST(PlaceLabels, KeepsClearOfLines) {
  const std::vector<std::pair<double, double>> points = {{60, 100}, {240, 95}}, sizes = {{30, 12}, {50, 12}};
  const std::vector<Box> boxes = place_labels(points, sizes, {0, 0, 300, 200}, {{points[0], points[1]}});
  for (const Box& box : boxes)
    for (int x = 60; x <= 240; ++x) {
      EXPECT_FALSE(box.overlaps({double(x), 100 - 5.0 * (x - 60) / 180, 0.1, 0.1})) << x;
    }
}

TEST(Ticks, AreRoundNumbers) {
  EXPECT_THAT(linear_ticks(0, 1, 6), ElementsAre(0, 0.2, 0.4, ::testing::DoubleEq(0.6), 0.8, 1));
  EXPECT_THAT(linear_ticks(0, 13.9, 6), ElementsAre(0, 5, 10));
  EXPECT_THAT(log_ticks(0.9, 60, 6), ElementsAre(1, 2, 5, 10, 20, 50));
  EXPECT_THAT(log_ticks(0.9, 600, 6), ElementsAre(1, 3, 10, 30, 100, 300));
  EXPECT_THAT(log_ticks(0.01, 1e5, 4), ElementsAre(0.01, 1, 100, 10000));
  EXPECT_THAT(log_ticks(0.1, 0.4, 6), ElementsAre(0.1, 0.2));
}

TEST(Ticks, AreWrittenWithoutAnExponent) {
  EXPECT_EQ(tick_text(0.05), "0.05");
  EXPECT_EQ(tick_text(2), "2");
  EXPECT_EQ(tick_text(3 * 0.1), "0.3");
  EXPECT_EQ(tick_text(20000), "20000");
}

ScatterPlot two_panels() {
  ScatterPlot plot;
  plot.title = "Error <& time>";
  plot.x_label = "s";
  plot.panels.push_back({"one", "before: 3", "mm", {{"ours", {{1, 2, "fast"}, {10, 1, "slow"}}, true, false}}, false});
  plot.panels.push_back({"two", "", "mm", {{"theirs", {{5, 0.5, "tool"}}, false, false}}, true});
  return plot;
}

TEST(ToSvg, ShowsEveryPointOnceAndEachSeriesInTheLegend) {
  const std::string svg = to_svg(two_panels());
  EXPECT_THAT(svg, HasSubstr("Error &lt;&amp; time&gt;"));
  const std::regex circle("<circle"), text("<text"), end("</text>");
  const auto count = [&](const std::regex& what) {
    return std::distance(std::sregex_iterator(svg.begin(), svg.end(), what), std::sregex_iterator());
  };
  EXPECT_EQ(count(circle), 3 + 2);  // points and legend
  EXPECT_EQ(count(text), count(end));
  for (const char* word : {">fast<", ">slow<", ">tool<", ">ours<", ">theirs<", ">one<", ">two<", "before: 3"})
    EXPECT_THAT(svg, HasSubstr(word));
}

// Oracle: on a logarithmic axis equal factors are equal distances.
TEST(ToSvg, PlacesPointsLogarithmically) {
  ScatterPlot plot;
  plot.panels.push_back({"one", "", "", {{"a", {{1, 1, ""}, {10, 2, ""}, {100, 4, ""}}, false, false}}, false});
  const std::string svg = to_svg(plot);
  const std::regex circle("<circle cx=\"([0-9.]+)\" cy=\"([0-9.]+)\"");
  std::vector<double> x, y;
  for (std::sregex_iterator at(svg.begin(), svg.end(), circle), end; at != end; ++at)
    x.push_back(std::stod((*at)[1])), y.push_back(std::stod((*at)[2]));
  ASSERT_GE(x.size(), 3u);
  EXPECT_NEAR(x[1] - x[0], x[2] - x[1], 0.2);
  EXPECT_NEAR(y[1] - y[2], 2 * (y[0] - y[1]), 0.3);
}

TEST(ToSvg, RefusesWhatItsAxesCannotShow) {
  for (const auto& [x, y] : {std::pair{0.0, 1.0},
                             {-1.0, 1.0},
                             {1.0, std::nan("")},
                             {std::numeric_limits<double>::infinity(), 1.0},
                             {1.0, 0.0}}) {
    ScatterPlot plot = two_panels();
    plot.panels[1].series[0].points[0] = {x, y, ""};
    EXPECT_THROW(to_svg(plot), std::invalid_argument) << x << " " << y;
  }
  ScatterPlot empty = two_panels();
  empty.panels[0].series.clear();
  EXPECT_THROW(to_svg(empty), std::invalid_argument);
}

}  // namespace
}  // namespace saltus::benchmark
