#include "client/cli/study/kernel_figures.h"

#include "core/drawing/colour_map.h"
#include "core/drawing/line_chart.h"
#include "core/drawing/markup.h"
#include "core/drawing/sheet.h"

#include <cmath>
#include <limits>

namespace saltus::cli {
namespace {

using namespace drawing;

std::string width_text(double width_mm) { return "width " + number(width_mm) + " px"; }

std::vector<std::unique_ptr<KernelProfile>> profiles(double width_mm) {
  std::vector<std::unique_ptr<KernelProfile>> both;
  both.push_back(make_gaussian_profile(width_mm));
  both.push_back(make_wendland_profile(width_mm));
  return both;
}

std::string shown_name(const KernelProfile& profile) {
  return profile.name() == "gaussian" ? "Gaussian" : "C0 Wendland";
}

ColourScale scale_of(double most) {
  const std::string text = number(most, 2);
  return {[](double t) { return diverging(2 * t - 1); }, {"-" + text, "0", text}, ""};
}

}  // namespace

double kernel_slope(const KernelProfile& profile, double r) {
  const double step = 1e-5 * profile.width();
  return (profile.value(r + step) - profile.value(r - step)) / (2 * step);
}

Figure kernels_along_a_line(double width_mm) {
  LineChart values, slopes;
  values.title = "Kernel k0";
  slopes.title = "Its derivative";
  values.x_label = slopes.x_label = "r [px]";
  const double reach = 1.6 * width_mm;
  constexpr int steps = 400;
  for (const auto& profile : profiles(width_mm)) {
    Curve value{shown_name(*profile), {}}, slope = value;
    for (int i = -steps; i <= steps; ++i) {
      const double r = reach * i / steps;
      value.points.emplace_back(r, profile->value(r));
      // A curve that is drawn through the jump at 0 would show a slope that the kernel does not have.
      const bool is_jump = i == 0 && profile->name() == "wendland";
      slope.points.emplace_back(r, is_jump ? std::numeric_limits<double>::quiet_NaN() : kernel_slope(*profile, r));
    }
    values.curves.push_back(std::move(value));
    slopes.curves.push_back(std::move(slope));
  }
  return {"kernels_1d", "The kernels in one dimension",
          "exp(-r^2/s^2) and ((1-|r|/s)+)^2, " + width_text(width_mm) +
              ". The C0 Wendland kernel has a kink at 0, and its derivative a jump: that is what lets a motion slide.",
          sheet({{{"", to_raster(values, 1.4), {}}, {"", to_raster(slopes, 1.4), {}}}})};
}

Figure kernels_in_the_plane(double width_mm) {
  // An even number of pixels, so that none lies on the planes across which the derivatives jump.
  constexpr int pixels = 240;
  const double reach = 1.3 * width_mm;
  std::vector<std::vector<SheetPanel>> rows;
  for (const auto& profile : profiles(width_mm)) {
    const auto panel = [&](const std::string& caption, double most, const auto& value_at) {
      Raster picture(pixels, pixels);
      for (int row = 0; row < pixels; ++row)
        for (int column = 0; column < pixels; ++column) {
          const auto place = [&](int i) { return reach * ((2 * i + 1.0) / pixels - 1); };
          picture.at(column, row) = diverging(value_at(place(column), place(row)) / most);
        }
      return SheetPanel{shown_name(*profile) + ": " + caption, std::move(picture), scale_of(most)};
    };
    const auto k = [&](double r) { return profile->value(r); };
    const auto slope = [&](double r) { return kernel_slope(*profile, r); };
    // Both derivatives on one scale, that of C0 Wendland: 2 / width at the jump.
    const double steepest = 2 / width_mm;
    rows.push_back({panel("K", 1, [&](double x, double y) { return k(x) * k(y); }),
                    panel("dK/dx", steepest, [&](double x, double y) { return slope(x) * k(y); }),
                    panel("dK/dy", steepest, [&](double x, double y) { return k(x) * slope(y); })});
  }
  return {"kernels_2d", "The kernels in the plane",
          "K(x, y) = k0(x) k0(y) and its derivatives, " + width_text(width_mm) +
              "; y points down. The derivatives of the Wendland kernel jump across the lines x = 0 and y = 0.",
          sheet(rows)};
}

}  // namespace saltus::cli
