#include "client/cli/study/elementary_deformations.h"

#include "core/drawing/markup.h"
#include "core/drawing/overlay_lines.h"
#include "core/drawing/sheet.h"
#include "core/flow/backward_map.h"
#include "core/flow/geodesic_shooting.h"
#include "core/kernels/kernel_profile.h"

#include <algorithm>
#include <cmath>

namespace saltus::cli {
namespace {

using namespace drawing;

constexpr int time_steps = 20;
// Fine enough that a jump between two samples looks like one.
constexpr int samples = 129;
constexpr double spacing_mm = 0.5;

VectorVolume<2> shoot(std::unique_ptr<KernelProfile> profile, Orders orders, double largest_mm) {
  Lattice<2> lattice;
  lattice.size.fill(samples);
  lattice.spacing.fill(spacing_mm);
  MomentumScale<2, double> scale({.kernel = std::move(profile), .lattice = lattice, .orders = orders});
  const std::size_t middle = lattice.sites() / 2, size = scale.field_size();
  // Order 0 has one field, order 1 one for each derivative: the second is that along y. Each begins with x.
  std::vector<double> momentum(has_first(orders) ? 2 * size : size, 0.0), velocity(size);
  double& strength = momentum[(has_first(orders) ? size : 0) + 2 * middle];
  strength = 1;
  const double* const zeroth = has_first(orders) ? nullptr : momentum.data();
  const double* const first = has_first(orders) ? momentum.data() : nullptr;
  scale.synthesise(zeroth, first, velocity.data());
  double fastest = 0;
  for (double v : velocity) fastest = std::max(fastest, std::abs(v));
  strength = largest_mm / fastest;

  GeodesicShooting<2, double> shooting({&scale}, lattice, time_steps, Evolution::Carried);
  shooting.shoot({{zeroth, first}});
  const Field<double> moved = forward_map(lattice, lattice, shooting.velocities());
  ImageGrid<2> grid;
  grid.size = lattice.size;
  grid.spacing.setConstant(spacing_mm);
  VectorVolume<2> displacement(grid);
  for (std::size_t site = 0; site < lattice.sites(); ++site)
    for (int c = 0; c < 2; ++c) displacement.component(c)[site] = static_cast<float>(moved[2 * site + c]);
  return displacement;
}

}  // namespace

std::vector<ElementaryDeformation> elementary_deformations(double gaussian_mm, double wendland_mm, double largest_mm) {
  return {{"Gaussian, order 0: translation", shoot(make_gaussian_profile(gaussian_mm), Orders::Zeroth, largest_mm)},
          {"Gaussian, order 1: shear", shoot(make_gaussian_profile(gaussian_mm), Orders::First, largest_mm)},
          {"C0 Wendland, order 1: sliding", shoot(make_wendland_profile(wendland_mm), Orders::First, largest_mm)}};
}

Figure elementary_figure() {
  constexpr double gaussian_mm = 12, wendland_mm = 28, largest_mm = 4;
  constexpr int magnification = 3;
  std::vector<SheetPanel> row;
  for (const ElementaryDeformation& one : elementary_deformations(gaussian_mm, wendland_mm, largest_mm)) {
    const SlicePlane<2> plane = choose_planes(one.displacement).front();
    Raster picture(plane.width * magnification, plane.height * magnification);
    std::fill(picture.pixels.begin(), picture.pixels.end(), Colour{247, 247, 245});
    draw(picture, scaled(deformed_grid_lines(one.displacement, plane), magnification),
         {.colour = {31, 95, 168}, .width = 1.3});
    const double middle = picture.width / 2.0;
    draw(picture, {{{middle, middle}, {middle, middle}}}, {.colour = {192, 57, 43}, .width = 9});
    row.push_back({one.name, std::move(picture), {}});
  }
  return {"elementary", "The three elementary deformations",
          "One momentum along x (red) and the grid that its flow carries along: of order 0 it translates what is "
          "around it, of order 1 along y it shears, smoothly with a Gaussian kernel and with a jump across y = 0 with "
          "the C0 Wendland kernel. Kernel widths " +
              number(gaussian_mm) + " and " + number(wendland_mm) + " px, initial velocity at most " +
              number(largest_mm) + " px.",
          sheet({row})};
}

}  // namespace saltus::cli
