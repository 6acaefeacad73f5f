#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "core/grid/noise.h"
#include "core/similarity/similarity.h"
#include "core/support/reduction.h"

namespace saltus {
namespace {

template <int Dim>
using Arrow = std::array<double, Dim>;

template <int Dim>
double dot(const Arrow<Dim>& a, const Arrow<Dim>& b) {
  double sum = 0;
  for (int axis = 0; axis < Dim; ++axis) sum += a[axis] * b[axis];
  return sum;
}

/// n = <g_f, g_w>, A = |g_f|^2 + e_f^2, B = |g_w|^2 + e_w^2, E = V sum of weight (1 - n^2 / (A B)). With
///     dE/dg_w = -V weight 2 n / (A B) (g_f - n / B g_w)     (and f alike),
/// sample y collects from its own difference quotients and from those of its neighbours, on each axis:
///     g(y) = [ weight(y+1) (I(y+1) - I(y)) + weight(y-1) (I(y) - I(y-1)) ] / (2 h).
template <int Dim, class T>
class GradientFields final : public Similarity<Dim, T> {
 public:
  GradientFields(const Lattice<Dim>& lattice, double edge) : lattice_(lattice), given_edge_(edge) {
    std::ptrdiff_t stride = 1;
    for (int axis = 0; axis < Dim; ++axis) {
      stride_[axis] = stride;
      stride *= lattice.size[axis];
      half_[axis] = 0.5 / lattice.spacing[axis];
    }
  }

  void prepare(const T* fixed, const T* resting, const T* weights) override {
    double f = edge_of(fixed, weights), w = edge_of(resting, weights);
    // An image without any edge takes the other's measure; without any edge at all every measure will do.
    if (f == 0) f = w > 0 ? w : 1;
    if (w == 0) w = f;
    fixed_edge2_ = f * f;
    warped_edge2_ = w * w;
    is_prepared_ = true;
  }

  double evaluate(const T* fixed, const T* warped, const T* weights, T* gradient, T* weight_gradient) override {
    if (!is_prepared_) throw std::logic_error("normalised gradient fields are evaluated before prepare");
    const double volume = lattice_.cell_volume();
    const std::size_t sites = lattice_.sites();
    warped_duals_.resize(Dim * sites);
    if (weight_gradient) fixed_duals_.resize(Dim * sites);
    const double energy = ordered_rows([&](const Index<Dim>& index, std::size_t site) {
      T* warped_dual = warped_duals_.data() + Dim * site;
      T* fixed_dual = weight_gradient ? fixed_duals_.data() + Dim * site : nullptr;
      const double weight = weights ? double(weights[site]) : 1.0;
      if (weight == 0 && !weight_gradient) {
        std::fill_n(warped_dual, Dim, T(0));
        return 0.0;
      }
      const Arrow<Dim> g_f = difference(fixed, weights, index, site), g_w = difference(warped, weights, index, site);
      const double n = dot<Dim>(g_f, g_w);
      const double a = dot<Dim>(g_f, g_f) + fixed_edge2_, b = dot<Dim>(g_w, g_w) + warped_edge2_;
      const double unlike = 1 - n / a * (n / b);
      if (weight_gradient) weight_gradient[site] = static_cast<T>(volume * unlike);
      if (weight == 0) {  // not a product with 0: what is hidden may be NaN
        std::fill_n(warped_dual, Dim, T(0));
        std::fill_n(fixed_dual, Dim, T(0));
        return 0.0;
      }
      const double factor = -2 * volume * weight * (n / a) / b;
      for (int axis = 0; axis < Dim; ++axis) {
        warped_dual[axis] = static_cast<T>(factor * (g_f[axis] - n / b * g_w[axis]));
        if (fixed_dual) fixed_dual[axis] = static_cast<T>(factor * (g_w[axis] - n / a * g_f[axis]));
      }
      return volume * weight * unlike;
    });
    ordered_rows([&](const Index<Dim>& index, std::size_t site) {
      collect(warped, weights, warped_duals_.data(), index, site, gradient, weight_gradient);
      if (weight_gradient) collect(fixed, weights, fixed_duals_.data(), index, site, nullptr, weight_gradient);
      return 0.0;
    });
    return energy;
  }

 private:
  /// Sum of term(index, site), slab by slab, in an order that does not depend on the number of threads.
  template <class Term>
  double ordered_rows(Term&& term) const {
    const int slabs = lattice_.size[Dim - 1];
    std::vector<double> sums(slabs);
#pragma omp parallel for schedule(static)
    for (int slab = 0; slab < slabs; ++slab) {
      double sum = 0;
      visit_slab<Dim>(lattice_, slab, [&](const Index<Dim>& index, std::size_t site) { sum += term(index, site); });
      sums[slab] = sum;
    }
    double sum = 0;
    for (double part : sums) sum += part;
    return sum;
  }

  /// The weight of the neighbour `step` (1 or -1) along the axis: 0 beyond the border.
  double neighbour(const T* weights, const Index<Dim>& index, std::size_t site, int axis, int step) const {
    const int at = index[axis] + step;
    if (at < 0 || at >= lattice_.size[axis]) return 0;
    return weights ? double(weights[site + static_cast<std::size_t>(step * stride_[axis])]) : 1.0;
  }

  Arrow<Dim> difference(const T* image, const T* weights, const Index<Dim>& index, std::size_t site) const {
    Arrow<Dim> g;
    for (int axis = 0; axis < Dim; ++axis) {
      const double up = neighbour(weights, index, site, axis, 1), down = neighbour(weights, index, site, axis, -1);
      const std::size_t stride = static_cast<std::size_t>(stride_[axis]);
      double sum = 0;
      if (up > 0) sum += up * (double(image[site + stride]) - image[site]);
      if (down > 0) sum += down * (double(image[site]) - image[site - stride]);
      g[axis] = half_[axis] * sum;
    }
    return g;
  }

  /// The transpose of `difference`, for one sample: writes to `gradient` (unless null), adds to `weight_gradient`.
  void collect(const T* image, const T* weights, const T* duals, const Index<Dim>& index, std::size_t site, T* gradient,
               T* weight_gradient) const {
    const double weight = weights ? double(weights[site]) : 1.0;
    double image_part = 0, weight_part = 0;
    for (int axis = 0; axis < Dim; ++axis) {
      const std::size_t stride = static_cast<std::size_t>(stride_[axis]);
      const double own = duals[Dim * site + axis];
      for (int step : {-1, 1}) {
        const double shown = neighbour(weights, index, site, axis, step);
        if (!(shown > 0)) continue;  // its duals are 0 as well
        const std::size_t there = step < 0 ? site - stride : site + stride;
        const double theirs = duals[Dim * there + axis];
        // Seen from the neighbour, this sample lies the other way.
        image_part -= half_[axis] * step * (weight * theirs + shown * own);
        if (weight_gradient) weight_part += half_[axis] * step * theirs * (double(image[there]) - image[site]);
      }
    }
    if (gradient) gradient[site] = weight == 0 ? T(0) : static_cast<T>(image_part);
    if (weight_gradient) weight_gradient[site] += static_cast<T>(weight_part);
  }

  /// Gradients below this are noise, or small against what the image has elsewhere.
  double edge_of(const T* image, const T* weights) const {
    if (given_edge_ > 0) return given_edge_;
    double per_mm2 = 0;  // mean square of the difference quotients of unit noise
    for (int axis = 0; axis < Dim; ++axis)
      if (lattice_.size[axis] > 1) per_mm2 += 2 * half_[axis] * half_[axis];
    const double noise = kNoise * noise_sd<Dim>(lattice_, image, weights) * std::sqrt(per_mm2);
    const auto shown = [&](std::size_t site) { return weights ? double(weights[site]) : 1.0; };
    const double seen = ordered_rows([&](const Index<Dim>&, std::size_t site) { return shown(site); });
    if (!(seen > 0)) return 0;
    const double mean = ordered_rows([&](const Index<Dim>& index, std::size_t site) {
                          if (shown(site) == 0) return 0.0;
                          const Arrow<Dim> g = difference(image, weights, index, site);
                          return shown(site) * std::sqrt(dot<Dim>(g, g));
                        }) /
                        seen;
    return std::sqrt(noise * noise + kFloor * kFloor * mean * mean);
  }

  static constexpr double kNoise = 2;    ///< edges against the gradients of the noise
  static constexpr double kFloor = 0.1;  ///< edges against the mean gradient

  Lattice<Dim> lattice_;
  double given_edge_;
  std::array<std::ptrdiff_t, Dim> stride_;
  std::array<double, Dim> half_;  ///< 1 / (2 spacing)
  double fixed_edge2_ = 0, warped_edge2_ = 0;
  bool is_prepared_ = false;
  Field<T> warped_duals_, fixed_duals_;
};

}  // namespace

template <int Dim, class T>
std::unique_ptr<Similarity<Dim, T>> make_gradient_fields(const Lattice<Dim>& lattice, double edge) {
  return std::make_unique<GradientFields<Dim, T>>(lattice, edge);
}

template std::unique_ptr<Similarity<2, float>> make_gradient_fields(const Lattice<2>&, double);
template std::unique_ptr<Similarity<3, float>> make_gradient_fields(const Lattice<3>&, double);
template std::unique_ptr<Similarity<2, double>> make_gradient_fields(const Lattice<2>&, double);
template std::unique_ptr<Similarity<3, double>> make_gradient_fields(const Lattice<3>&, double);

}  // namespace saltus
