#include "client/cli/study/elementary_deformations.h"
#include "client/cli/study/kernel_figures.h"
#include "client/cli/study/pair_figures.h"
#include "client/cli/study/study_page.h"
#include "core/drawing/colour_map.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace saltus::cli {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

/// Largest difference of u_x between vertical neighbours in the column of the momentum.
double largest_step(const VectorVolume<2>& u) {
  double most = 0;
  const int nx = u.grid.size[0], column = nx / 2;
  for (int row = 0; row + 1 < u.grid.size[1]; ++row)
    most = std::max(most, std::abs(static_cast<double>(u.component(0)[(row + 1) * nx + column]) -
                                   u.component(0)[row * nx + column]));
  return most;
}

double at_middle(const VectorVolume<2>& u, int rows_below) {
  return u.component(0)[(u.grid.size[1] / 2 + rows_below) * u.grid.size[0] + u.grid.size[0] / 2];
}

TEST(ElementaryDeformations, TranslateShearAndSlide) {
  const auto all = elementary_deformations(12, 28, 4);
  ASSERT_EQ(all.size(), 3u);
  const VectorVolume<2>&translation = all[0].displacement, &shear = all[1].displacement, &slide = all[2].displacement;
  // Order 0 is even in y, order 1 along y odd, and one cell more or less decides about neither of the smooth ones.
  EXPECT_GT(std::abs(at_middle(translation, 0)), 3);
  EXPECT_NEAR(at_middle(translation, 10), at_middle(translation, -10), 0.05);
  EXPECT_GT(std::abs(at_middle(shear, 12)), 2);
  EXPECT_NEAR(at_middle(shear, 13), -at_middle(shear, -12), 0.2);
  EXPECT_LT(largest_step(translation), 0.3);
  EXPECT_LT(largest_step(shear), 0.6);
  // The Wendland kernel jumps between two neighbouring samples, by nearly twice the largest velocity.
  EXPECT_GT(largest_step(slide), 5);
  EXPECT_LT(at_middle(slide, 1) * at_middle(slide, 0), 0);
  // All moves along x alone, as the momentum does.
  for (const auto& one : all)
    for (std::size_t i = 0; i < one.displacement.grid.voxels(); ++i)
      ASSERT_LT(std::abs(one.displacement.component(1)[i]), 1e-6) << one.name;
}

TEST(KernelSlope, IsTheDerivativeInClosedForm) {
  const auto gaussian = make_gaussian_profile(9), wendland = make_wendland_profile(9);
  for (double r : {-8.0, -3.0, -0.1, 0.1, 2.0, 7.5}) {
    EXPECT_NEAR(kernel_slope(*gaussian, r), -2 * r / 81 * std::exp(-r * r / 81), 1e-6);
    EXPECT_NEAR(kernel_slope(*wendland, r), -2 * (r > 0 ? 1 : -1) / 9.0 * (1 - std::abs(r) / 9), 1e-4);
  }
  EXPECT_EQ(kernel_slope(*wendland, 0), 0);
  EXPECT_EQ(kernel_slope(*wendland, 9.5), 0);
}

TEST(KernelsInThePlane, ShowTheJumpOfTheWendlandDerivative) {
  const drawing::Raster picture = kernels_in_the_plane(9).picture;
  // The steepest colours, both ends of the scale, meet nowhere but in the Wendland derivatives and the scales.
  const auto touches = [&](int right, int down) {
    const drawing::Colour low = drawing::diverging(-1), high = drawing::diverging(1);
    const auto near = [](drawing::Colour a, drawing::Colour b) {
      return std::abs(a[0] - b[0]) + std::abs(a[1] - b[1]) + std::abs(a[2] - b[2]) < 40;
    };
    int count = 0;
    for (int row = 0; row + down < picture.height; ++row)
      for (int column = 0; column + right < picture.width; ++column)
        count += near(picture.at(column, row), high) && near(picture.at(column + right, row + down), low);
    return count;
  };
  EXPECT_GE(touches(1, 0), 2);
  EXPECT_GE(touches(0, 1), 2);
}

PairResults<2> moved_square() {
  ImageGrid<2> grid;
  grid.size = {40, 40};
  PairResults<2> pair;
  pair.fixed = pair.moving = Volume<2>(grid);
  for (int y = 10; y < 25; ++y)
    for (int x = 10; x < 25; ++x) {
      pair.fixed.samples[y * 40 + x] = 1;
      pair.moving.samples[y * 40 + x + 5] = 1;
    }
  ModelResult<2> perfect{"perfect", VectorVolume<2>(grid), pair.fixed};
  std::fill_n(perfect.displacement.component(0), grid.voxels(), 5.0f);
  ModelResult<2> idle{"idle", VectorVolume<2>(grid), pair.moving};
  pair.models = {perfect, idle};
  return pair;
}

std::ptrdiff_t count(const drawing::Raster& raster, drawing::Colour colour) {
  return std::count(raster.pixels.begin(), raster.pixels.end(), colour);
}

TEST(PairFigures, ShowNoDifferenceWhereAModelIsPerfect) {
  PairResults<2> pair = moved_square();
  const auto plane = main_plane(pair.models[0].displacement);
  // Before and after an idle model differ alike; a perfect one adds no pixel of the difference's colours.
  const drawing::Colour red = drawing::diverging(1), blue = drawing::diverging(-1);
  const auto both = [&] {
    const drawing::Raster raster = difference_sheet(pair, plane);
    return count(raster, red) + count(raster, blue);
  };
  const auto all = both();
  pair.models.resize(1);
  const auto without_idle = both();
  pair.models.clear();
  const auto before = both();
  EXPECT_GT(before, 100);
  EXPECT_NEAR(static_cast<double>(without_idle), static_cast<double>(before), 20);
  EXPECT_NEAR(static_cast<double>(all), 2.0 * static_cast<double>(before), 60);
}

TEST(PairFigures, PaintMagnitudesOnOneScale) {
  PairResults<2> pair = moved_square();
  const auto plane = main_plane(pair.models[0].displacement);
  const drawing::Raster raster = deformation_sheet(pair, plane);
  // 400 x 400 pixels for each model: 5 mm everywhere is the scale's end, 0 its beginning.
  EXPECT_GE(count(raster, drawing::sequential(1)), 400 * 400);
  EXPECT_GE(count(raster, drawing::sequential(0)), 400 * 400);
}

TEST(StudyPage, LoadsNothingAndHoldsItsPicturesAndTables) {
  Study study;
  study.title = "A <study>";
  study.tables.push_back({"Table", "of |u|", {"name", "value"}, {{"a|b", "1"}}});
  Figure figure{"one", "One", "caption", drawing::Raster(3, 2)};
  study.figures.push_back(figure);
  const std::string html = to_html(study);
  EXPECT_THAT(html, HasSubstr("A &lt;study&gt;"));
  EXPECT_THAT(html, HasSubstr(drawing::data_uri(figure.picture)));
  EXPECT_THAT(html, HasSubstr("default-src 'none'"));
  EXPECT_THAT(html, Not(HasSubstr("http://")));
  EXPECT_THAT(html, Not(HasSubstr("https://")));
  EXPECT_EQ(to_markdown(study.tables), "## Table\n\nof |u|\n\n| name | value |\n|---|---:|\n| a\\|b | 1 |\n\n");
}

}  // namespace
}  // namespace saltus::cli
