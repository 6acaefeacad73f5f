#include "server/worker/report/figures.h"

#include "server/worker/report/colour_map.h"
#include "server/worker/report/markup.h"
#include "server/worker/report/overlay_paths.h"
#include "server/worker/report/pictures.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <sstream>

namespace saltus::report {
namespace {

/// Colour bar from left to right with a text at each end and in the middle.
std::string colour_bar(const std::function<Colour(double)>& colour_at, const std::array<std::string, 3>& texts,
                       const std::string& unit) {
  constexpr int steps = 128;
  Raster bar(steps, 1);
  for (int i = 0; i < steps; ++i) bar.at(i, 0) = colour_at(i / (steps - 1.0));
  std::string html = "<div class=\"bar\"><img alt=\"\" src=\"" + data_uri(bar) + "\"><div>";
  for (const std::string& text : texts) html += "<span>" + escaped(text) + "</span>";
  return html + "</div><div class=\"unit\">" + escaped(unit) + "</div></div>";
}

template <int Dim>
class Figures {
 public:
  explicit Figures(const ReportInput<Dim>& input)
      : input_(input), pictures_(input), planes_(choose_planes(input.result->displacement)) {}

  std::string sections() const {
    const std::string range = number(100 * pictures_.difference_range(), 2);
    const std::string bar = colour_bar([](double t) { return diverging(2 * t - 1); }, {"-" + range, "0", "+" + range},
                                       "% of the intensity window");
    std::vector<std::string> images{
        figure("Fixed", "what stays", &Pictures<Dim>::fixed),
        figure("Moving", has_start() ? "after the affine start" : "as it came", &Pictures<Dim>::moving),
        figure("Registered", "moving(x + u(x))", &Pictures<Dim>::warped)};
    std::vector<std::string> match{
        figure("Difference before", "moving - fixed", &Pictures<Dim>::difference_before, bar),
        figure("Difference after", "registered - fixed", &Pictures<Dim>::difference_after, bar)};
    // Flat pictures stand three in a row, volumes two.
    (Dim == 2 ? match : images)
        .push_back(figure("Checkerboard", "fixed and registered by turns", &Pictures<Dim>::checkerboard));
    const std::vector<std::string> deformation{displacement_figure(),
                                               figure("Jacobian determinant", "blue shrinks, red grows, magenta folds",
                                                      &Pictures<Dim>::jacobian, jacobian_bar()),
                                               grid_figure()};
    return "<section><h2>Images</h2>" + where() + gallery(images) + "</section>\n<section><h2>Match</h2>" +
           gallery(match) + "</section>\n<section><h2>Deformation</h2>" + gallery(deformation) + "</section>\n" +
           momenta_section();
  }

 private:
  using Painter = Raster (Pictures<Dim>::*)(const SlicePlane<Dim>&) const;

  bool has_start() const { return !(input_.input->start == AffineMap<Dim>{}); }

  static std::string gallery(const std::vector<std::string>& figures) {
    std::string html = Dim == 2 ? "<div class=\"flat gallery\">" : "<div class=\"gallery\">";
    for (const std::string& figure : figures) html += figure;
    return html + "</div>\n";
  }

  /// One picture per plane, all at the same scale: the first on the left, the others on top of each other beside it.
  std::string panels(const std::function<std::string(const SlicePlane<Dim>&)>& content) const {
    const auto wide = [](const SlicePlane<Dim>& plane) { return plane.width * plane.pixel_mm; };
    std::ostringstream html;
    html << "<div class=\"panels\"><div class=\"stack\" style=\"flex:" << wide(planes_.front()) << " 1 0\">"
         << panel(planes_.front(), 1, content) << "</div>";
    if (Dim == 3) {
      const double widest = std::max(wide(planes_[1]), wide(planes_[2]));
      html << "<div class=\"stack\" style=\"flex:" << widest << " 1 0\">"
           << panel(planes_[1], wide(planes_[1]) / widest, content)
           << panel(planes_[2], wide(planes_[2]) / widest, content) << "</div>";
    }
    html << "</div>";
    return html.str();
  }

  static std::string panel(const SlicePlane<Dim>& plane, double share,
                           const std::function<std::string(const SlicePlane<Dim>&)>& content) {
    return "<div style=\"width:" + number(100 * share) + "%\"><div class=\"frame\">" + content(plane) +
           label(plane.left_label, "left") + label(plane.right_label, "right") + label(plane.top_label, "top") +
           label(plane.bottom_label, "bottom") + "</div>" +
           (plane.name.empty() ? "" : "<div class=\"plane\">" + plane.name + "</div>") + "</div>";
  }

  static std::string label(const std::string& text, const std::string& side) {
    return text.empty() ? "" : "<span class=\"side " + side + "\">" + text + "</span>";
  }

  static std::string image(const SlicePlane<Dim>& plane, const Raster& raster, const std::string& what) {
    // Few pixels are shown as the squares they are; many are scaled smoothly.
    const char* scaling = std::max(raster.width, raster.height) < 200 ? " class=\"pixels\"" : "";
    return "<img" + std::string(scaling) + " alt=\"" + escaped(plane.name.empty() ? what : what + ", " + plane.name) +
           "\" src=\"" + data_uri(raster) + "\">";
  }

  static std::string caption(const std::string& title, const std::string& explanation) {
    return "<figcaption><b>" + escaped(title) + "</b>" + " <span>" + escaped(explanation) + "</span></figcaption>";
  }

  std::string figure(const std::string& title, const std::string& explanation, Painter painter,
                     const std::string& bar = "") const {
    return "<figure>" + caption(title, explanation) +
           panels([&](const SlicePlane<Dim>& plane) { return image(plane, (pictures_.*painter)(plane), title); }) +
           bar + "</figure>\n";
  }

  static std::string overlay(const SlicePlane<Dim>& plane, const std::string& kind, const std::string& path) {
    return "<svg class=\"overlay " + kind + "\" viewBox=\"0 0 " + std::to_string(plane.width) + ' ' +
           std::to_string(plane.height) + "\" preserveAspectRatio=\"none\"><path d=\"" + path + "\"/></svg>";
  }

  std::string displacement_figure() const {
    return "<figure>" + caption("Displacement", "length of u(x); arrows: from x towards x + u(x)") +
           panels([&](const SlicePlane<Dim>& plane) {
             return image(plane, pictures_.displacement(plane), "Displacement") +
                    overlay(plane, "arrows",
                            arrow_path(input_.result->displacement, plane, pictures_.displacement_range()));
           }) +
           displacement_bar() + "</figure>\n";
  }

  std::string grid_figure() const {
    return "<figure>" + caption("Deformed grid", "fixed grid carried by u over the moving image") +
           panels([&](const SlicePlane<Dim>& plane) {
             return image(plane, pictures_.moving(plane), "Deformed grid") +
                    overlay(plane, "lines", deformed_grid_path(input_.result->displacement, plane));
           }) +
           "</figure>\n";
  }

  std::string displacement_bar() const {
    const double most = pictures_.displacement_range();
    return colour_bar(sequential, {"0", number(most / 2), number(most)}, "mm");
  }

  std::string jacobian_bar() const {
    const double range = pictures_.jacobian_range();
    return colour_bar([](double t) { return diverging(2 * t - 1); }, {number(1 / range), "1", number(range)},
                      "det D(x + u), logarithmic");
  }

  std::string momenta_section() const {
    const auto& momenta = input_.result->momenta;
    if (momenta.empty()) return "";
    std::string html =
        "<section><h2>Initial momenta</h2><p>Length of the momentum vectors; bright is large, the image "
        "shows through where there is none.</p>";
    std::vector<std::string> figures;
    for (std::size_t i = 0; i < momenta.size(); ++i) {
      const MomentumField<Dim>& field = momenta[i];
      const std::string order = field.axis < 0 ? "Order 0" : std::string("Order 1, axis ") + "xyz"[field.axis];
      figures.push_back(
          "<figure>" + caption(order, field.kernel + " kernel, width " + number(field.width_mm) + " mm") +
          panels([&](const SlicePlane<Dim>& plane) { return image(plane, pictures_.momentum(plane, i), order); }) +
          colour_bar([](double t) { return heat(0.35 + 0.65 * t); },
                     {"0", number(pictures_.momentum_range(i) / 2), number(pictures_.momentum_range(i))}, "") +
          "</figure>\n");
    }
    return html + gallery(figures) + "</section>\n";
  }

  /// Says which slices are shown and why.
  std::string where() const {
    if (Dim == 2) return "";
    std::ostringstream text;
    text << "<p>Slices where u varies most from place to place (largest sum of |gradient of u| over the slice): voxel ";
    const Vector<Dim>& position = planes_.front().position;
    for (int axis = 0; axis < Dim; ++axis) text << (axis ? ", " : "") << std::lround(position[axis]);
    const Vector<Dim> world = input_.input->fixed.grid.to_world(position);
    text << "; world ";
    for (int axis = 0; axis < Dim; ++axis) text << (axis ? ", " : "") << number(world[axis], 4);
    text << " mm (LPS).</p>";
    return text.str();
  }

  const ReportInput<Dim>& input_;
  Pictures<Dim> pictures_;
  std::vector<SlicePlane<Dim>> planes_;
};

}  // namespace

template <int Dim>
std::string figure_sections(const ReportInput<Dim>& input) {
  return Figures<Dim>(input).sections();
}

template std::string figure_sections(const ReportInput<2>&);
template std::string figure_sections(const ReportInput<3>&);

}  // namespace saltus::report
