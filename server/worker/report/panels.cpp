#include "server/worker/report/panels.h"

#include "core/drawing/markup.h"

#include <algorithm>

namespace saltus::report {

using namespace drawing;

namespace {

std::string label(const std::string& text, const std::string& side) {
  return text.empty() ? "" : "<span class=\"side " + side + "\">" + text + "</span>";
}

}  // namespace

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
std::string Panels<Dim>::figure(const std::string& title, const std::string& explanation, const Content& content,
                                const std::string& below) const {
  std::string html = "<figure><figcaption><b>" + escaped(title) + "</b> <span>" + escaped(explanation) +
                     "</span></figcaption><div class=\"panels\">";
  for (const SlicePlane<Dim>& plane : planes_)
    html += "<div style=\"flex:" + number(static_cast<double>(plane.width) / plane.height, 4) +
            " 1 0\"><div class=\"frame\">" + content(plane) + side_labels(plane) + "</div>" +
            (plane.name.empty() ? "" : "<div class=\"plane\">" + plane.name + "</div>") + "</div>";
  return html + "</div>" + below + "</figure>\n";
}

template <int Dim>
std::string Panels<Dim>::gallery(const std::vector<std::string>& figures, GalleryWidth width) {
  std::string html = Dim == 2                       ? "<div class=\"flat gallery\">"
                     : width == GalleryWidth::Whole ? "<div class=\"wide gallery\">"
                                                    : "<div class=\"gallery\">";
  for (const std::string& figure : figures) html += figure;
  return html + "</div>\n";
}

template <int Dim>
std::string Panels<Dim>::image(const SlicePlane<Dim>& plane, const Raster& raster, const std::string& what) {
  return image(plane, data_uri(raster), what);
}

template <int Dim>
std::string Panels<Dim>::image(const SlicePlane<Dim>& plane, const std::string& uri, const std::string& what) {
  // Few pixels are shown as the squares they are; many are scaled smoothly.
  const char* scaling = std::max(plane.width, plane.height) < 200 ? " class=\"pixels\"" : "";
  return "<img" + std::string(scaling) + " alt=\"" + escaped(plane.name.empty() ? what : what + ", " + plane.name) +
         "\" src=\"" + uri + "\">";
}

template <int Dim>
std::string Panels<Dim>::overlay(const SlicePlane<Dim>& plane, const std::string& kind, const std::string& paths) {
  return "<svg class=\"overlay " + kind + "\" viewBox=\"0 0 " + std::to_string(plane.width) + ' ' +
         std::to_string(plane.height) + "\" preserveAspectRatio=\"none\">" + paths + "</svg>";
}

template <int Dim>
std::string Panels<Dim>::side_labels(const SlicePlane<Dim>& plane) {
  return label(plane.left_label, "left") + label(plane.right_label, "right") + label(plane.top_label, "top") +
         label(plane.bottom_label, "bottom");
}

template class Panels<2>;
template class Panels<3>;

}  // namespace saltus::report
