#include "server/worker/report/figures.h"

#include "core/drawing/colour_map.h"
#include "core/drawing/line_chart.h"
#include "core/drawing/markup.h"
#include "core/drawing/overlay_lines.h"
#include "server/worker/report/interface_paths.h"
#include "server/worker/report/landmark_marks.h"
#include "server/worker/report/panels.h"
#include "server/worker/report/pictures.h"
#include "server/worker/report/slip_marks.h"
#include "server/worker/report/viewer.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <sstream>
#include <utility>

namespace saltus::report {

using namespace drawing;

namespace {

// Longest sides, pixels. A page has a hundred pictures of a volume, so these decide how heavy it is.
constexpr int flat_picture = 512, largest_picture = 384, small_picture = 224;

template <int Dim>
class Figures {
 public:
  Figures(const ReportInput<Dim>& input, const Analysis<Dim>& analysis)
      : input_(input),
        analysis_(analysis),
        pictures_(input, analysis.displacement),
        panels_(planes(Dim == 2 ? flat_picture : largest_picture)),
        small_panels_(planes(Dim == 2 ? largest_picture : small_picture)) {
    for (const SlicePlane<Dim>& plane : panels_.planes()) {
      fixed_[plane.name] = data_uri(pictures_.fixed(plane));
      moving_[plane.name] = data_uri(pictures_.moving(plane));
    }
  }

  std::string sections() const {
    return viewer_section(input_, pictures_, panels_.planes()) + "<section><h2>Images</h2>" + where() +
           Panels<Dim>::gallery(images(), GalleryWidth::Whole) + "</section>\n<section><h2>Match</h2>" +
           Panels<Dim>::gallery(match(), GalleryWidth::Whole) + "</section>\n<section><h2>Deformation</h2>" +
           Panels<Dim>::gallery(deformation(), GalleryWidth::Whole) + "</section>\n" + landmark_part() +
           sliding_section();
  }

 private:
  using Painter = Raster (Pictures<Dim>::*)(const SlicePlane<Dim>&) const;

  bool has_start() const { return !(input_.input->start == AffineMap<Dim>{}); }

  std::vector<SlicePlane<Dim>> planes(int longest_side) const {
    const auto& strongest = analysis_.may_slide ? analysis_.strongest_slip : analysis_.interface.strongest;
    return strongest ? planes_through(*strongest, input_.input->fixed.grid, longest_side)
                     : choose_planes(input_.result->displacement, longest_side);
  }

  std::string figure(const std::string& title, const std::string& explanation, Painter painter,
                     const std::string& bar = "") const {
    return panels_.figure(
        title, explanation,
        [&](const SlicePlane<Dim>& plane) { return Panels<Dim>::image(plane, (pictures_.*painter)(plane), title); },
        bar);
  }

  std::string fixed(const SlicePlane<Dim>& plane, const std::string& what) const {
    return Panels<Dim>::image(plane, fixed_.at(plane.name), what);
  }
  std::string moving(const SlicePlane<Dim>& plane, const std::string& what) const {
    return Panels<Dim>::image(plane, moving_.at(plane.name), what);
  }

  std::vector<std::string> images() const {
    return {panels_.figure("Fixed", "what stays", [&](const SlicePlane<Dim>& plane) { return fixed(plane, "Fixed"); }),
            panels_.figure("Moving", has_start() ? "after the affine start" : "as it came",
                           [&](const SlicePlane<Dim>& plane) { return moving(plane, "Moving"); }),
            figure("Registered", "moving(x + u(x))", &Pictures<Dim>::warped)};
  }

  std::vector<std::string> match() const {
    const std::string range = number(100 * pictures_.difference_range(), 2);
    const std::string bar = colour_bar([](double t) { return diverging(2 * t - 1); }, {"-" + range, "0", "+" + range},
                                       "% of the intensity window");
    return {figure("Difference before", "moving - fixed", &Pictures<Dim>::difference_before, bar),
            figure("Difference after", "registered - fixed", &Pictures<Dim>::difference_after, bar),
            figure("Checkerboard", "fixed and registered by turns", &Pictures<Dim>::checkerboard)};
  }

  std::vector<std::string> deformation() const {
    return {displacement_figure(),
            figure("Jacobian determinant", "blue shrinks, red grows, magenta folds", &Pictures<Dim>::jacobian,
                   jacobian_bar()),
            grid_figure()};
  }

  static std::string path(const std::string& commands) { return "<path d=\"" + commands + "\"/>"; }

  std::string displacement_figure() const {
    const double most = pictures_.displacement_range();
    return panels_.figure(
        "Displacement", "length of u(x); arrows: from x towards x + u(x)",
        [&](const SlicePlane<Dim>& plane) {
          return Panels<Dim>::image(plane, pictures_.displacement(plane), "Displacement") +
                 Panels<Dim>::overlay(plane, "arrows",
                                      path(svg_path(arrow_lines(input_.result->displacement, plane, most))));
        },
        colour_bar(sequential, {"0", number(most / 2), number(most)}, "mm"));
  }

  std::string grid_figure() const {
    return panels_.figure(
        "Deformed grid", "fixed grid carried by u over the moving image", [&](const SlicePlane<Dim>& plane) {
          return moving(plane, "Deformed grid") +
                 Panels<Dim>::overlay(plane, "lines",
                                      path(svg_path(deformed_grid_lines(input_.result->displacement, plane))));
        });
  }

  std::string jacobian_bar() const {
    const double range = pictures_.jacobian_range();
    return colour_bar([](double t) { return diverging(2 * t - 1); }, {number(1 / range), "1", number(range)},
                      "det D(x + u), logarithmic");
  }

  std::string landmark_part() const {
    if (!analysis_.landmarks) return "";
    const Statistics after = summarise(analysis_.landmarks->after);
    const double most = after.max > 0 ? after.max : 1;
    std::size_t shown = 0;
    const auto over = [&shown](const SlicePlane<Dim>& plane, const LandmarkMarks& marks) {
      shown += marks.shown;
      return Panels<Dim>::overlay(plane, "landmarks", marks.svg);
    };
    const std::string given =
        panels_.figure("Landmarks of the fixed image", "rings", [&](const SlicePlane<Dim>& plane) {
          return fixed(plane, "Fixed, with landmarks") + over(plane, fixed_landmark_marks(input_, plane));
        });
    const std::string carried = panels_.figure(
        "Where they are carried",
        "over the moving image; ring: its landmark, dot: where x + u(x) leads, line: the error",
        [&](const SlicePlane<Dim>& plane) {
          return moving(plane, "Moving, with landmarks") + over(plane, carried_landmark_marks(input_, plane, most));
        },
        colour_bar(interface_colour, {"0", number(most / 2), number(most)}, "mm"));
    std::string text = "<section><h2>Landmarks over the images</h2>";
    if (Dim == 3) {
      text += "<p>Those near each slice, up to";
      std::string separator = " ";
      for (const SlicePlane<Dim>& plane : panels_.planes())
        text += std::exchange(separator, ", ") + number(landmark_reach_mm(input_.input->fixed.grid, plane), 2) +
                " mm (" + plane.name + ")";
      text += shown == 0 ? ": there are none.</p>" : ".</p>";
    }
    return text + Panels<Dim>::gallery({given, carried}, GalleryWidth::Whole) + "</section>\n";
  }

  std::string sliding_section() const {
    return std::string("<section><h2>") + (analysis_.may_slide ? "Where it slides" : "Where it changes most") +
           "</h2>\n" + interface_part() + momenta_part() + "</section>\n";
  }

  std::string interface_part() const {
    const bool is_empty = analysis_.may_slide ? !(analysis_.slip.area > 0) : analysis_.interface.faces.empty();
    if (is_empty)
      return "<p>No sliding interface found: " +
             (analysis_.may_slide ? "no momentum makes the motion jump by " + number(least_jump()) + " mm."
                                  : "the displacement jumps nowhere by " + number(least_jump()) +
                                        " mm between neighbouring voxels, the least that is looked for.") +
             " The motion that was found is smooth.</p>\n";
    const double most = largest_shown();
    const ImageGrid<Dim>& grid = input_.input->fixed.grid;
    const std::string picture = panels_.figure(
        analysis_.may_slide ? "Tangential jump" : "Tangential change",
        analysis_.may_slide
            ? "of u, along the surface that first-order momenta make (within half a slice); squares: it lies in the "
              "slice"
            : "of u across the interface that was found in it; faint squares: the interface lies in the slice",
        [&](const SlicePlane<Dim>& plane) {
          return fixed(plane, "Tangential jump") +
                 Panels<Dim>::overlay(plane, "interface",
                                      analysis_.may_slide ? slip_marks(input_.result->slip, grid, plane, most)
                                                          : interface_paths(analysis_.interface, grid, plane, most));
        },
        colour_bar(interface_colour, {"0", number(most / 2), number(most) + " and more"}, "mm"));
    const std::string figures = analysis_.may_slide ? slip_line() : jump_table();
    return "<p>" + origin_of_interface() + "</p>\n" +
           (Dim == 2 ? "<div class=\"columns\">" + picture + "<div>" + figures + jump_chart() + "</div></div>\n"
                     : Panels<Dim>::gallery({picture}, GalleryWidth::Whole) + "<div class=\"columns\">" + figures +
                           jump_chart() + "</div>\n");
  }

  double least_jump() const {
    return analysis_.may_slide ? input_.result->slip.least_jump_mm : analysis_.interface.threshold_mm;
  }

  double largest_shown() const {
    if (analysis_.may_slide) return analysis_.slip.jump_p95_mm;
    const Statistics& slip = analysis_.interface.slip_mm;
    return slip.p90 > 0 ? slip.p90 : slip.max;
  }

  std::string origin_of_interface() const {
    if (analysis_.may_slide)
      return "The surface that the first-order momenta make, in the fixed image; point by point in interface.csv and "
             "interface.vtp. The jump is that of u, taken from both sides; the gap is measured where both sides lie in "
             "the moving image. Jumps below " +
             number(least_jump()) + " mm are left out.";
    return "No sliding interface found: no first-order momenta take part, so the motion is smooth. These are places "
           "where it changes within few voxels, found in the displacement alone, wherever its change between two "
           "neighbouring voxels is at least " +
           number(least_jump()) +
           " mm and not explained by the slopes beside it. The jump is split into slip along the interface and opening "
           "across it.";
  }

  std::string slip_line() const {
    const SlipSummary& slip = analysis_.slip;
    return "<div><p>" + number(slip.area) + (Dim == 2 ? " mm" : " mm\u00b2") + " in " + std::to_string(slip.parts) +
           (slip.parts == 1 ? " part" : " parts") + "; tangential jump " + number(slip.jump_mean_mm) +
           " mm in the mean, on 95 % of it below " + number(slip.jump_p95_mm) + " mm; on 95 % of it the gap is below " +
           number(slip.gap_p95_mm) + " mm and the overlap below " + number(slip.overlap_p95_mm) + " mm.</p></div>";
  }

  std::string jump_table() const {
    const DetectedInterface<Dim>& found = analysis_.interface;
    const auto row = [](const std::string& name, const Statistics& values) {
      return std::vector<std::string>{
          name, number(values.mean), number(values.sd), number(values.median), number(values.p90), number(values.max)};
    };
    return "<div><p>" + extent_text(found) + " of interface, " + std::to_string(found.faces.size()) +
           " faces between voxels.</p>" +
           table({"mm", "mean", "sd", "median", "90 %", "max"},
                 {row("slip, tangential", found.slip_mm), row("opening or closing, normal", found.gap_mm)}) +
           "</div>";
  }

  /// Sizes and what they stand for, ready to be summed up.
  using Sizes = std::vector<std::pair<double, double>>;

  std::string jump_chart() const {
    // Share of the interface that jumps by at least so much.
    const auto curve = [](const std::string& name, Sizes sizes) {
      std::sort(sizes.begin(), sizes.end());
      double all = 0;
      for (const auto& [size, extent] : sizes) all += extent;
      Curve shares{name, {{0, 100}}};
      double left = all;
      const std::size_t step = sizes.size() / 200 + 1;
      for (std::size_t i = 0; i < sizes.size(); ++i) {
        if (i % step == 0 || i + 1 == sizes.size()) shares.points.emplace_back(sizes[i].first, 100 * left / all);
        left -= sizes[i].second;
      }
      return shares;
    };
    Sizes slips, gaps;
    if (analysis_.may_slide)
      for (const SlipPoint<Dim>& point : input_.result->slip.points) {
        slips.emplace_back(point.jump.norm(), point.area);
        gaps.emplace_back(std::abs(point.gap_mm), point.area);
      }
    else
      for (const InterfaceFace<Dim>& face : analysis_.interface.faces) {
        slips.emplace_back(face.slip_mm, face.extent);
        gaps.emplace_back(std::abs(face.opening_mm), face.extent);
      }
    return to_svg({.title = "Interface with at least this jump",
                   .x_label = "jump [mm]",
                   .y_label = "share [%]",
                   .curves = {curve("slip", std::move(slips)), curve("opening or closing", std::move(gaps))},
                   .y_starts_at_zero = true});
  }

  std::string momenta_part() const {
    const auto& momenta = input_.result->momenta;
    if (momenta.empty()) return "";
    std::string html =
        "<h3>Initial momenta</h3><p>Length of the momentum vectors; bright is large, the image shows through where "
        "there is none. Order 0 moves smoothly; a first-order momentum along an axis lets the velocity jump across "
        "planes that the axis is normal to, an oriented one across the plane that it is turned to.</p>";
    std::vector<std::string> figures;
    std::string empty;
    for (std::size_t i = 0; i < momenta.size(); ++i) {
      const MomentumField<Dim>& field = momenta[i];
      const std::string order = field.axis == MomentumField<Dim>::kZeroth ? "Order 0"
                                : field.axis == MomentumField<Dim>::kOriented
                                    ? "Order 1, oriented"
                                    : std::string("Order 1, axis ") + "xyz"[field.axis];
      if (active_share(field.vectors) == 0) {
        empty += (empty.empty() ? "" : "; ") + order + ", width " + number(field.width_mm) + " mm";
        continue;
      }
      figures.push_back(small_panels_.figure(
          order, field.kernel + " kernel, width " + number(field.width_mm) + " mm",
          [&](const SlicePlane<Dim>& plane) { return Panels<Dim>::image(plane, pictures_.momentum(plane, i), order); },
          colour_bar([](double t) { return heat(0.35 + 0.65 * t); },
                     {"0", number(pictures_.momentum_range(i) / 2), number(pictures_.momentum_range(i))}, "")));
    }
    if (!empty.empty()) empty = "<p>Without a momentum anywhere: " + empty + ".</p>\n";
    return html + Panels<Dim>::gallery(figures, GalleryWidth::Shared) + empty;
  }

  /// Says which slices are shown and why.
  std::string where() const {
    if (Dim == 2) return "";
    std::ostringstream text;
    text << "<p>Slices "
         << ((analysis_.may_slide ? analysis_.strongest_slip : analysis_.interface.strongest)
                 ? "through the point of the largest tangential " +
                       std::string(analysis_.may_slide ? "jump" : "change") + " (summed over the interface around it)"
                 : "where u varies most from place to place (largest sum of |gradient of u| over the slice)")
         << ": voxel ";
    const Vector<Dim>& position = panels_.planes().front().position;
    for (int axis = 0; axis < Dim; ++axis) text << (axis ? ", " : "") << std::lround(position[axis]);
    const Vector<Dim> world = input_.input->fixed.grid.to_world(position);
    text << "; world ";
    for (int axis = 0; axis < Dim; ++axis) text << (axis ? ", " : "") << number(world[axis], 4);
    text << " mm (LPS).</p>";
    return text.str();
  }

  const ReportInput<Dim>& input_;
  const Analysis<Dim>& analysis_;
  Pictures<Dim> pictures_;
  Panels<Dim> panels_, small_panels_;
  std::map<std::string, std::string> fixed_, moving_;  ///< of panels_, by the plane's name: several figures show them
};

}  // namespace

template <int Dim>
std::string figure_sections(const ReportInput<Dim>& input, const Analysis<Dim>& analysis) {
  return Figures<Dim>(input, analysis).sections();
}

template std::string figure_sections(const ReportInput<2>&, const Analysis<2>&);
template std::string figure_sections(const ReportInput<3>&, const Analysis<3>&);

}  // namespace saltus::report
