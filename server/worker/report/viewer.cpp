#include "server/worker/report/viewer.h"

#include "core/drawing/colour_map.h"
#include "core/drawing/markup.h"
#include "core/drawing/raster.h"
#include "server/worker/report/panels.h"
#include "server/worker/report/viewer_script.h"

#include <nlohmann/json.hpp>

#include <openssl/evp.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <stdexcept>

namespace saltus::report {

using namespace drawing;

namespace {

/// A volume as the page carries it: every f-th voxel along each axis, 2-D as one slice.
template <int Dim>
class ThinnedVolumes {
 public:
  explicit ThinnedVolumes(const ImageGrid<Dim>& grid) : grid_(grid) {
    factors_.fill(1);
    while (voxels() > most_voxels) {
      int finest = 0;
      for (int axis = 1; axis < Dim; ++axis)
        if (factors_[axis] * grid_.spacing[axis] < factors_[finest] * grid_.spacing[finest]) finest = axis;
      ++factors_[finest];
    }
    columns_ = static_cast<int>(std::ceil(std::sqrt(size(2))));
  }

  int size(int axis) const {
    if (axis >= Dim) return 1;
    return (grid_.size[axis] + factors_[axis] - 1) / factors_[axis];
  }
  int columns() const { return columns_; }
  int factor(int axis) const { return axis < Dim ? factors_[axis] : 1; }

  /// Slices side by side, as a picture's bytes; `value` of a voxel's index is clipped to 0 ... 255. Several
  /// threads ask for it.
  template <class Value>
  GreyRaster atlas(const Value& value) const {
    const int rows = (size(2) + columns_ - 1) / columns_;
    GreyRaster picture(columns_ * size(0), rows * size(1));
#pragma omp parallel for schedule(static)
    for (int z = 0; z < size(2); ++z)
      for (int y = 0; y < size(1); ++y)
        for (int x = 0; x < size(0); ++x) {
          const std::array<int, 3> at{x, y, z};
          Vector<Dim> index;
          for (int axis = 0; axis < Dim; ++axis)
            index[axis] = std::min(at[axis] * factors_[axis] + factors_[axis] / 2, grid_.size[axis] - 1);
          const double clipped = std::clamp(value(index), 0.0, 255.0);
          picture.at(z % columns_ * size(0) + x, z / columns_ * size(1) + y) =
              static_cast<std::uint8_t>(std::lround(clipped));
        }
    return picture;
  }

 private:
  std::size_t voxels() const {
    std::size_t all = 1;
    for (int axis = 0; axis < Dim; ++axis) all *= static_cast<std::size_t>(size(axis));
    return all;
  }

  const ImageGrid<Dim>& grid_;
  std::array<int, Dim> factors_{};
  int columns_ = 1;
};

std::string hexadecimal(const Colour& colour) {
  char text[8];
  std::snprintf(text, sizeof text, "%02x%02x%02x", colour[0], colour[1], colour[2]);
  return text;
}

template <class Map>
std::string colours(const Map& map) {
  std::string text;
  for (int i = 0; i < 256; ++i) text += hexadecimal(map(i / 255.0));
  return text;
}

template <int Dim>
nlohmann::json geometry(const ReportInput<Dim>& input, const Pictures<Dim>& pictures,
                        const std::vector<SlicePlane<Dim>>& planes, const ThinnedVolumes<Dim>& thinned) {
  const ImageGrid<Dim>& grid = input.input->fixed.grid;
  nlohmann::json json;
  Vector<Dim> first;
  for (int axis = 0; axis < 3; ++axis) {
    json["size"].push_back(thinned.size(axis));
    const int start = axis < Dim ? static_cast<int>(planes.front().position[axis]) / thinned.factor(axis) : 0;
    json["start"].push_back(start);
    if (axis < Dim) first[axis] = std::min(thinned.factor(axis) / 2, grid.size[axis] - 1);
  }
  const Vector<Dim> origin = grid.to_world(first);
  for (int row = 0; row < Dim; ++row) {
    json["origin"].push_back(origin[row]);
    nlohmann::json axes = nlohmann::json::array();
    for (int axis = 0; axis < Dim; ++axis)
      axes.push_back(grid.direction(row, axis) * grid.spacing[axis] * thinned.factor(axis));
    json["axes"].push_back(axes);
  }
  for (const SlicePlane<Dim>& plane : planes)
    json["planes"].push_back({{"right", plane.right_axis},
                              {"down", plane.down_axis},
                              {"across", plane.slice_axis},
                              {"rightReversed", plane.right_is_reversed},
                              {"downReversed", plane.down_is_reversed}});
  json["columns"] = thinned.columns();
  json["differenceRange"] = pictures.difference_range();
  json["displacementRange"] = pictures.displacement_range();
  json["jacobianRange"] = pictures.jacobian_range();
  json["sequential"] = colours(sequential);
  json["diverging"] = colours([](double t) { return diverging(2 * t - 1); });
  json["folded"] = hexadecimal(folded);
  return json;
}

std::string volume_image(const std::string& name, const GreyRaster& picture) {
  return "<img hidden alt=\"\" data-volume=\"" + name + "\" src=\"" + data_uri(picture) + "\">\n";
}

std::string button(const std::string& view, const std::string& text) {
  return "<button type=\"button\" data-view=\"" + view + "\">" + text + "</button>";
}

std::string legend(const std::string& views, const std::string& content) {
  return "<div data-for=\"" + views + "\" hidden>" + content + "</div>";
}

}  // namespace

template <int Dim>
std::string viewer_section(const ReportInput<Dim>& input, const Pictures<Dim>& pictures,
                           const std::vector<SlicePlane<Dim>>& planes) {
  const ThinnedVolumes<Dim> thinned(input.input->fixed.grid);
  std::string html =
      "<noscript><p>Scripts are off, so there is nothing to slide or flicker here; the pictures below show the same in "
      "fixed slices.</p></noscript>\n";
  html += std::string("<section id=\"viewer\"") + (Dim == 2 ? " class=\"flat-viewer\"" : "") +
          " hidden data-geometry=\"" + escaped(geometry(input, pictures, planes, thinned).dump()) +
          "\"><h2>Look at it</h2>\n";
  const auto scaled = [](double share) { return 255 * share; };
  html += volume_image("fixed", thinned.atlas([&](const auto& at) { return scaled(pictures.fixed_at(at)); }));
  html += volume_image("moving", thinned.atlas([&](const auto& at) { return scaled(pictures.moving_at(at)); }));
  html += volume_image("registered", thinned.atlas([&](const auto& at) { return scaled(pictures.warped_at(at)); }));
  html += volume_image("displacement", thinned.atlas([&](const auto& at) {
    return scaled(pictures.displacement_at(at) / pictures.displacement_range());
  }));
  html += volume_image("jacobian", thinned.atlas([&](const auto& at) {
    const double j = pictures.jacobian_at(at);
    // 0 is kept for folds.
    return j > 0 ? std::max(1.0, 128 + 127 * std::log2(j) / std::log2(pictures.jacobian_range())) : 0.0;
  }));

  html += "<div class=\"views\" role=\"group\" aria-label=\"What is shown\">" + button("wipe", "Slider") +
          button("flicker", "Flicker") + button("checkerboard", "Checkerboard") + button("fixed", "Fixed") +
          button("moving", "Moving") + button("registered", "Registered") + button("before", "Difference before") +
          button("after", "Difference after") + button("displacement", "Displacement") +
          button("jacobian", "Jacobian") + "</div>\n<div class=\"panels\">";
  for (std::size_t i = 0; i < planes.size(); ++i) {
    const SlicePlane<Dim>& plane = planes[i];
    const std::string ratio = number(static_cast<double>(plane.width) / plane.height, 4);
    html += "<div data-plane=\"" + std::to_string(i) + "\" style=\"flex:" + ratio + " 1 0\"><div class=\"frame\">" +
            "<canvas style=\"aspect-ratio:" + ratio + "\"></canvas><i class=\"upright\"></i><i class=\"level\"></i>" +
            "<i class=\"sweep\"></i>" + Panels<Dim>::side_labels(plane) + "</div>";
    if (plane.slice_axis >= 0)
      html += "<label class=\"plane\">" + plane.name + "<input type=\"range\" data-slice min=\"0\" max=\"" +
              std::to_string(thinned.size(plane.slice_axis) - 1) + "\"></label>";
    html += "</div>";
  }
  const std::string range = number(100 * pictures.difference_range(), 2);
  const double most = pictures.displacement_range(), ratio = pictures.jacobian_range();
  html +=
      "</div>\n<div class=\"below\"><div data-for=\"wipe\"><label>fixed left, registered right<input type=\"range\" "
      "data-split min=\"0\" max=\"100\" value=\"50\"></label></div>" +
      legend("flicker", "fixed and registered, turn about") + legend("checkerboard", "fixed and registered by turns") +
      legend("before after", colour_bar([](double t) { return diverging(2 * t - 1); }, {"-" + range, "0", "+" + range},
                                        "% of the intensity window")) +
      legend("displacement", colour_bar(sequential, {"0", number(most / 2), number(most)}, "mm")) +
      legend("jacobian", colour_bar([](double t) { return diverging(2 * t - 1); },
                                    {number(1 / ratio), "1", number(ratio)}, "magenta folds")) +
      "<div class=\"readout\"></div></div>\n<p>A click goes to a point.";
  if (Dim == 3 && (thinned.factor(0) > 1 || thinned.factor(1) > 1 || thinned.factor(2) > 1)) {
    html += " The volume is thinned here, by ";
    for (int axis = 0; axis < Dim; ++axis) html += (axis ? " x " : "") + std::to_string(thinned.factor(axis));
    html += "; the pictures below are finer.";
  }
  return html + "</p></section>\n<script>" + viewer_script + "</script>\n";
}

std::string content_policy() {
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
  unsigned int size = 0;
  const std::string_view script(viewer_script);
  if (!EVP_Digest(script.data(), script.size(), digest.data(), &size, EVP_sha256(), nullptr))
    throw std::runtime_error("the hash of the report's script cannot be computed");
  return "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-" +
         base64({reinterpret_cast<const char*>(digest.data()), size}) + "'; base-uri 'none'; form-action 'none'";
}

template std::string viewer_section(const ReportInput<2>&, const Pictures<2>&, const std::vector<SlicePlane<2>>&);
template std::string viewer_section(const ReportInput<3>&, const Pictures<3>&, const std::vector<SlicePlane<3>>&);

}  // namespace saltus::report
