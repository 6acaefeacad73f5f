#pragma once

#include <cmath>
#include <functional>
#include <memory>
#include <numbers>
#include <vector>

#include "core/flow/backward_map.h"
#include "core/flow/geodesic_shooting.h"
#include "core/momenta/spread_normals.h"
#include "core/registration/scales.h"
#include "core/slip/measure_slip.h"

namespace saltus::testing {

/// Oriented momenta on the surface distance(x) = 0 whose velocity jumps there by jump(x), from the side where the
/// distance is negative to the other, at t = 0; and the flow that they make.
template <int Dim>
class MadeSheet {
 public:
  using Function = std::function<double(const Vector<Dim>&)>;
  using VectorFunction = std::function<Vector<Dim>(const Vector<Dim>&)>;
  static constexpr double kWidth = 9;
  static constexpr double kSpread = 0.5;

  /// `normal` is a unit vector, the gradient of the distance.
  MadeSheet(const Lattice<Dim>& lattice, const Function& distance, const VectorFunction& normal,
            const VectorFunction& jump, double width = kWidth, int time_steps = 2)
      : lattice_(lattice) {
    MomentumScaleOptions<Dim> options;
    options.kernel = make_wendland_profile(width);
    options.lattice = lattice;
    options.orders = Orders::First;
    options.first_weight = 3;
    options.normals = spread_normals<Dim>(Dim == 2 ? 8 : 13);
    scale_ = std::make_unique<MomentumScale<Dim, float>>(options);
    OrientedMomenta<Dim, float>& oriented = *scale_->oriented();
    const double sample = lattice.spacing[0];
    std::vector<float> normals(Dim * lattice.sites(), 0.0f);
    for_sites([&](const Vector<Dim>& at, std::size_t site) {
      if (!(std::abs(distance(at)) < 3 * kSpread * sample)) return;
      const Vector<Dim> n = normal(at);
      for (int c = 0; c < Dim; ++c) normals[Dim * site + c] = static_cast<float>(n[c]);
    });
    oriented.turn(normals);
    elements_ = oriented.turned();
    std::vector<float> corners;
    oriented.place(elements_, corners);
    for (std::size_t e = 0; e < elements_.size(); ++e) {
      const auto place =
          OrientedMomenta<Dim, float>::placement(corners.data() + OrientedMomenta<Dim, float>::kCornerValues * e);
      const Vector<Dim> at = place.at.template cast<double>();
      // A Gaussian across the surface: of the sites at any angle it sums to one, within a percent.
      const double share = std::exp(-std::pow(distance(at) / (kSpread * sample), 2) / 2) /
                           (kSpread * sample * std::sqrt(2 * std::numbers::pi));
      const Vector<Dim> n = place.axes.row(0).transpose().template cast<double>();
      const double sign = n.dot(normal(at)) < 0 ? -1 : 1;
      for (int j = 1; j < Dim; ++j)
        values_.push_back(static_cast<float>(-sign * share * width / (6 * options.first_weight) *
                                             place.axes.row(j).transpose().template cast<double>().dot(jump(at))));
    }
    none_.assign(Dim * scale_->field_size(), 0.0f);
    const std::vector<MomentumPointers<float>> momenta{pointers()};
    GeodesicShooting<Dim, float> shooting({scale_.get()}, lattice, time_steps, Evolution::Carried);
    shooting.shoot(momenta);
    velocities_ = shooting.velocities();
  }

  MomentumPointers<float> pointers() const {
    MomentumPointers<float> momenta;
    momenta.first = none_.data();
    momenta.elements = &elements_;
    momenta.oriented = values_.data();
    return momenta;
  }
  std::vector<JumpElements<Dim>> elements() const { return jump_elements<Dim, float>(*scale_, pointers()); }
  const std::vector<Field<float>>& velocities() const { return velocities_; }
  const MomentumScale<Dim, float>& scale() const { return *scale_; }

  /// The slip surface on a fixed image of the lattice's samples, in the frame turned and moved as `grid` says.
  /// The moving image covers what `start` makes of the fixed one.
  SlipSurface<Dim> surface(const ImageGrid<Dim>& grid, const AffineMap<Dim>& start = {}) const {
    ImageGrid<Dim> moving = grid;
    moving.origin = start(grid.origin);
    for (int a = 0; a < Dim; ++a) {
      const Vector<Dim> axis = start.linear * grid.direction.col(a);
      moving.spacing[a] *= axis.norm();
      moving.direction.col(a) = axis.normalized();
    }
    return surface(grid, start, moving);
  }
  SlipSurface<Dim> surface(const ImageGrid<Dim>& grid, const AffineMap<Dim>& start,
                           const ImageGrid<Dim>& moving) const {
    const Field<float> backward = backward_map<Dim, float>(lattice_, lattice_, velocities_);
    return measure_slip<Dim>(elements(), {lattice_, velocities_, grid, backward, start, moving});
  }
  SlipSurface<Dim> surface() const { return surface(grid()); }
  ImageGrid<Dim> grid() const {
    ImageGrid<Dim> grid;
    grid.size = lattice_.size;
    for (int a = 0; a < Dim; ++a) grid.spacing[a] = lattice_.spacing[a];
    return grid;
  }

 private:
  template <class Visit>
  void for_sites(Visit&& visit) const {
    for (int slab = 0; slab < lattice_.size[Dim - 1]; ++slab)
      visit_slab<Dim>(lattice_, slab, [&](const Index<Dim>& index, std::size_t site) {
        Vector<Dim> at;
        for (int a = 0; a < Dim; ++a) at[a] = lattice_.offset[a] + index[a] * lattice_.spacing[a];
        visit(at, site);
      });
  }

  Lattice<Dim> lattice_;
  std::unique_ptr<MomentumScale<Dim, float>> scale_;
  std::vector<typename OrientedMomenta<Dim, float>::Element> elements_;
  std::vector<float> values_, none_;
  std::vector<Field<float>> velocities_;
};

}  // namespace saltus::testing
