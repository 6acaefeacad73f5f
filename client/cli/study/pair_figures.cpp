#include "client/cli/study/pair_figures.h"

#include "core/drawing/colour_map.h"
#include "core/drawing/field_sampling.h"
#include "core/drawing/markup.h"
#include "core/drawing/overlay_lines.h"
#include "core/drawing/painting.h"
#include "core/drawing/sheet.h"
#include "core/evaluation/statistics.h"

#include <algorithm>
#include <cmath>

namespace saltus::cli {
namespace {

using namespace drawing;

// Pictures are made about so wide, by whole magnifications.
constexpr int wanted_pixels = 400;

constexpr Colour grid_colour{255, 210, 62}, arrow_colour{235, 40, 30};

/// Paints all panels of a pair on one set of scales.
template <int Dim>
class Painter {
 public:
  Painter(const PairResults<Dim>& pair, const SlicePlane<Dim>& plane)
      : pair_(pair),
        plane_(plane),
        factor_(std::max(1, (wanted_pixels + plane.width / 2) / std::max(plane.width, plane.height))),
        fixed_window_(window_of(pair.fixed)),
        moving_window_(window_of(pair.moving)) {
    for (const ModelResult<Dim>& model : pair.models) longest_mm_ = std::max(longest_mm_, longest(model.displacement));
    if (pair.truth) longest_mm_ = std::max(longest_mm_, longest(*pair.truth));
    if (!(longest_mm_ > 0)) longest_mm_ = 1;
    const ImageGrid<Dim>& grid = pair.fixed.grid;
    std::vector<double> differences;
    paint(plane, grid, [&](const Vector<Dim>& index, int, int) {
      differences.push_back(std::abs(moving_at(index) - fixed_at(index)));
      return Colour{};
    });
    std::sort(differences.begin(), differences.end());
    difference_range_ = std::max(0.02, quantile_of_sorted(differences, 0.99));
  }

  SheetPanel fixed() const {
    return panel("reference", [this](const Vector<Dim>& index) { return grey(fixed_at(index)); });
  }
  SheetPanel moving() const {
    return panel("template", [this](const Vector<Dim>& index) { return grey(moving_at(index)); });
  }
  SheetPanel warped(const ModelResult<Dim>& model) const {
    return panel(model.name, [&](const Vector<Dim>& index) { return grey(warped_at(model, index)); });
  }
  SheetPanel with_arrows(const ModelResult<Dim>& model) const {
    SheetPanel under = warped(model);
    draw(under.picture, scaled(arrow_lines(model.displacement, plane_, longest_mm_), factor_),
         {.colour = arrow_colour, .width = 1.8});
    return under;
  }
  SheetPanel magnitude(const std::string& caption, const VectorVolume<Dim>& displacement) const {
    SheetPanel made = panel(caption, [&](const Vector<Dim>& index) {
      return sequential(sample(displacement, index).norm() / longest_mm_);
    });
    made.scale = {sequential, {"0", number(longest_mm_ / 2), number(longest_mm_)}, "|u|, mm"};
    return made;
  }
  SheetPanel deformed_grid(const std::string& caption, const VectorVolume<Dim>& displacement) const {
    SheetPanel under = panel(caption, [this](const Vector<Dim>& index) { return grey(0.55 * moving_at(index)); });
    draw(under.picture, scaled(deformed_grid_lines(displacement, plane_), factor_), {grid_colour, 1.2});
    return under;
  }
  SheetPanel difference_before() const {
    return difference("before", [this](const Vector<Dim>& index) { return moving_at(index); });
  }
  SheetPanel difference_after(const ModelResult<Dim>& model) const {
    return difference("after, " + model.name, [&](const Vector<Dim>& index) { return warped_at(model, index); });
  }

 private:
  static double longest(const VectorVolume<Dim>& field) {
    double most = 0;
    for (std::size_t voxel = 0; voxel < field.grid.voxels(); ++voxel) {
      Vector<Dim> u;
      for (int c = 0; c < Dim; ++c) u[c] = field.component(c)[voxel];
      most = std::max(most, u.norm());
    }
    return most;
  }
  double fixed_at(const Vector<Dim>& index) const {
    return fixed_window_(sample(pair_.fixed.grid, pair_.fixed.samples.data(), index));
  }
  double moving_at(const Vector<Dim>& index) const {
    const ImageGrid<Dim>& grid = pair_.moving.grid;
    return moving_window_(sample(grid, pair_.moving.samples.data(), grid.to_index(pair_.fixed.grid.to_world(index))));
  }
  double warped_at(const ModelResult<Dim>& model, const Vector<Dim>& index) const {
    return moving_window_(sample(model.warped.grid, model.warped.samples.data(), index));
  }
  template <class ColourAt>
  SheetPanel panel(const std::string& caption, const ColourAt& colour_at) const {
    const Raster picture =
        paint(plane_, pair_.fixed.grid, [&](const Vector<Dim>& index, int, int) { return colour_at(index); });
    return {caption, magnified(picture, factor_), {}};
  }
  template <class Intensity>
  SheetPanel difference(const std::string& caption, const Intensity& intensity) const {
    SheetPanel made = panel(caption, [&](const Vector<Dim>& index) {
      return diverging((intensity(index) - fixed_at(index)) / difference_range_);
    });
    const std::string range = number(100 * difference_range_, 2);
    made.scale = {
        [](double t) { return diverging(2 * t - 1); }, {"-" + range, "0", range}, "% of the intensity window"};
    return made;
  }

  const PairResults<Dim>& pair_;
  const SlicePlane<Dim>& plane_;
  int factor_;
  IntensityWindow fixed_window_, moving_window_;
  double longest_mm_ = 0, difference_range_ = 1;
};

}  // namespace

template <int Dim>
SlicePlane<Dim> main_plane(const VectorVolume<Dim>& displacement) {
  const auto planes = choose_planes(displacement);
  const auto voxels = [&](const SlicePlane<Dim>& plane) {
    return displacement.grid.size[plane.right_axis] * displacement.grid.size[plane.down_axis];
  };
  return *std::max_element(planes.begin(), planes.end(),
                           [&](const auto& a, const auto& b) { return voxels(a) < voxels(b); });
}

template <int Dim>
Raster deformation_sheet(const PairResults<Dim>& pair, const SlicePlane<Dim>& plane) {
  const Painter<Dim> painter(pair, plane);
  std::vector<std::vector<SheetPanel>> rows(3);
  rows[0].push_back(painter.moving());
  rows[1].push_back(painter.fixed());
  rows[2].push_back(pair.truth ? painter.deformed_grid("true grid", *pair.truth) : SheetPanel{});
  for (const ModelResult<Dim>& model : pair.models) {
    rows[0].push_back(painter.warped(model));
    rows[1].push_back(painter.magnitude(model.name + ": magnitude", model.displacement));
    rows[2].push_back(painter.deformed_grid(model.name + ": grid", model.displacement));
  }
  return sheet(rows);
}

template <int Dim>
Raster field_sheet(const PairResults<Dim>& pair, const SlicePlane<Dim>& plane) {
  const Painter<Dim> painter(pair, plane);
  std::vector<std::vector<SheetPanel>> rows(2);
  rows[0].push_back(painter.moving());
  rows[1].push_back(painter.fixed());
  for (const ModelResult<Dim>& model : pair.models) {
    rows[0].push_back(painter.with_arrows(model));
    rows[1].push_back(painter.magnitude(model.name + ": magnitude", model.displacement));
  }
  return sheet(rows);
}

template <int Dim>
Raster difference_sheet(const PairResults<Dim>& pair, const SlicePlane<Dim>& plane) {
  const Painter<Dim> painter(pair, plane);
  std::vector<SheetPanel> row{painter.difference_before()};
  for (const ModelResult<Dim>& model : pair.models) row.push_back(painter.difference_after(model));
  return sheet({row});
}

#define SALTUS_INSTANTIATE(Dim)                                                       \
  template SlicePlane<Dim> main_plane(const VectorVolume<Dim>&);                      \
  template Raster deformation_sheet(const PairResults<Dim>&, const SlicePlane<Dim>&); \
  template Raster field_sheet(const PairResults<Dim>&, const SlicePlane<Dim>&);       \
  template Raster difference_sheet(const PairResults<Dim>&, const SlicePlane<Dim>&);
SALTUS_INSTANTIATE(2)
SALTUS_INSTANTIATE(3)
#undef SALTUS_INSTANTIATE

}  // namespace saltus::cli
