#include "core/momenta/momentum_scale.h"

#include "core/kernels/separable_convolution.h"
#include "core/support/errors.h"
#include "core/support/reduction.h"

#include <algorithm>

namespace saltus {

template <int Dim, class T>
MomentumScale<Dim, T>::Rows::Rows(const KernelTaps& taps, double share, double unit, double ratio)
    : value(scaled(taps.value, share)),
      slope(scaled(taps.slope, share * unit * ratio)),
      slope_transposed(reversed(scaled(taps.slope, share * unit * ratio))),
      curvature(scaled(taps.curvature, share * unit * unit)),
      slope_gram(scaled(taps.slope_gram, share * unit * ratio)),
      slope_gram_transposed(reversed(scaled(taps.slope_gram, share * unit * ratio))) {}

template <int Dim, class T>
MomentumScale<Dim, T>::MomentumScale(const MomentumScaleOptions<Dim>& options) : options_(options) {
  const std::vector<KernelComponent>& kernels = options.kernel.components();
  if (kernels.empty()) throw InvalidInput("a momentum scale has no kernel; give it one");
  if (options.orders == Orders::Oriented && options.normals.empty())
    throw InvalidInput("a momentum scale of oriented momenta alone has no normals; give it some");
  const bool zeroth = has_zeroth(options.orders);
  channel_weight_ = zeroth ? options.zeroth_weight : options.first_weight;
  const double ratio = options.first_weight / channel_weight_, width = options.kernel.width();
  first_order_unit_ = ratio * width;
  curvature_at_zero_.fill(0);
  for (const KernelComponent& kernel : kernels) {
    const double unit = width / kernel.profile->width();
    std::vector<Rows> by_axis;
    std::vector<KernelTaps> taps_of;
    for (int axis = 0; axis < Dim; ++axis) {
      taps_of.push_back(cell_averaged_taps(*kernel.profile, options.lattice.spacing[axis]));
      const KernelTaps& taps = taps_of.back();
      curvature_at_zero_[axis] += kernel.weight * unit * unit * taps.curvature[static_cast<std::size_t>(taps.radius)];
      by_axis.emplace_back(taps, axis == 0 ? kernel.weight * channel_weight_ : 1.0, unit, ratio);
      const Rows& rows = by_axis.back();
      for (const AxisTaps<T>* row : {&rows.value, &rows.slope, &rows.curvature})
        radius_[axis] = std::max(radius_[axis], row->radius());
    }
    const double of_zeroth = kernel.weight * channel_weight_ * options.lattice.cell_volume();
    components_.push_back({std::move(by_axis), AxisTaps<T>(scaled(taps_of[0].value, of_zeroth)),
                           AxisTaps<T>(scaled(taps_of[0].value, of_zeroth * ratio)),
                           AxisTaps<T>(scaled(taps_of[0].curvature, of_zeroth * ratio * unit * unit))});
  }
  if (!options.normals.empty())
    oriented_ = std::make_unique<OrientedMomenta<Dim, T>>(
        OrientedOptions<Dim>{options.lattice, options.normals, width, options.first_weight, options.oriented_spacing,
                             options.oriented_normal_share});
}

template <int Dim, class T>
MomentumMasks<Dim> MomentumScale<Dim, T>::everywhere() const {
  const auto all = BlockMask<Dim>::all(lattice()), none = BlockMask<Dim>::none(lattice());
  return MomentumMasks<Dim>(has_zeroth(options_.orders) ? all : none, has_first_order() ? all : none);
}

template <int Dim, class T>
T* MomentumScale<Dim, T>::scratch(int k) {
  Field<T>& field = scratch_[static_cast<std::size_t>(k)];
  if (field.empty()) field.resize(field_size());
  return field.data();
}

/// out = a_0 K * in, for the penalty times the cells' volume: order 0 alone, everywhere. What follows the first pass is
/// made where that has put it, and along the two axes of a plane at once.
template <int Dim, class T>
void MomentumScale<Dim, T>::smooth(bool is_gram, const T* in, T* out) {
  for (std::size_t q = 0; q < components_.size(); ++q) {
    const std::vector<Rows>& rows = components_[q].rows;
    const AxisTaps<T>& along_x = is_gram ? components_[q].zeroth_gram : rows[0].value;
    const Combine combine = q > 0 ? Combine::Add : Combine::Replace;
    T* between = q > 0 ? scratch(0) : out;
    convolve_axis<Dim, T>(lattice(), Dim, Dim - 1, rows[Dim - 1].value, Combine::Replace, in, between);
    if constexpr (Dim == 3)
      convolve_planes<T>(lattice(), Dim, rows[1].value, along_x, combine, between, out);
    else
      convolve_axis<Dim, T>(lattice(), Dim, 0, along_x, combine, between, out);
  }
}

/// Convolves with the kernel along all axes above `axis`; the result is in scratch 1 or 2, or `part` itself.
template <int Dim, class T>
auto MomentumScale<Dim, T>::smooth_axes_above(const Component& component, int axis, Part part) -> Part {
  for (int above = Dim - 1; above > axis; --above) {
    T* out = scratch(part.values == scratch(1) ? 2 : 1);
    const BlockMask<Dim> out_at = reach(part.at, above);
    convolve_axis<Dim, T>(lattice(), above, component.rows[above].value, Combine::Replace, part.at, part.values, out_at,
                          out);
    part = {out, out_at};
  }
  return part;
}

template <int Dim, class T>
BlockMask<Dim> MomentumScale<Dim, T>::synthesise(const T* zeroth, const T* first, const MomentumMasks<Dim>& at,
                                                 T* velocity) {
  if (zeroth && at.zeroth.is_all() && (!first || at.has_no_first())) {
    smooth(false, zeroth, velocity);
    return at.zeroth;
  }
  const auto none = BlockMask<Dim>::none(lattice());
  BlockMask<Dim> reached = none;
  for (std::size_t q = 0; q < components_.size(); ++q) {
    const std::vector<Rows>& rows = components_[q].rows;
    // One sweep over the axes, last to first: Z <- K_a Z + D_a (product of K_b, b > a) m_a. Z alternates between
    // scratch 0 and `velocity`, where it ends; later components only add to `velocity`, at the end.
    Part sum{zeroth, zeroth ? at.zeroth : none};
    for (int axis = Dim - 1; axis >= 0; --axis) {
      Part slopes{nullptr, none};
      if (first && !at.first[axis].is_empty())
        slopes = smooth_axes_above(components_[q], axis,
                                   {first + static_cast<std::size_t>(axis) * field_size(), at.first[axis]});
      const BlockMask<Dim> slopes_at = reach(slopes.at, axis);
      BlockMask<Dim> out_at = reach(sum.at, axis);
      out_at |= slopes_at;
      T* out = axis == 0 ? velocity : axis == 1 ? scratch(0) : q == 0 ? velocity : scratch(3);
      Combine combine = axis == 0 && q > 0 ? Combine::Add : Combine::Replace;
      if (!sum.at.is_empty()) {
        convolve_axis<Dim, T>(lattice(), axis, rows[axis].value, combine, sum.at, sum.values, out_at, out);
        combine = Combine::Add;
      }
      if (!slopes.at.is_empty())
        convolve_axis<Dim, T>(lattice(), axis, rows[axis].slope, combine, slopes.at, slopes.values,
                              combine == Combine::Add ? slopes_at : out_at, out);
      sum = {out, out_at};
    }
    reached = sum.at;
  }
  return reached;
}

template <int Dim, class T>
void MomentumScale<Dim, T>::synthesise_transpose(const T* velocity, const MomentumMasks<Dim>& wanted, T* zeroth,
                                                 T* first) {
  if (wanted.zeroth.is_all() && (!first || wanted.has_no_first())) {
    smooth(false, velocity, zeroth);
    return;
  }
  // Backwards from what is wanted: slope_needed[a] is needed of m_a's dual after the slope along a, sum_needed[a] of Z
  // before the passes along a.
  const auto none = BlockMask<Dim>::none(lattice());
  std::vector<BlockMask<Dim>> slope_needed(Dim, none), sum_needed(Dim + 1, none);
  sum_needed[Dim] = wanted.zeroth;
  for (int axis = Dim - 1; axis >= 0; --axis) {
    if (first) slope_needed[axis] = wanted.first[axis];
    for (int above = Dim - 1; above > axis; --above) slope_needed[axis] = reach(slope_needed[axis], above);
    sum_needed[axis] = sum_needed[axis + 1];
    sum_needed[axis] |= slope_needed[axis];
    sum_needed[axis] = reach(sum_needed[axis], axis);
  }
  for (std::size_t q = 0; q < components_.size(); ++q) {
    const std::vector<Rows>& rows = components_[q].rows;
    const Combine combine = q > 0 ? Combine::Add : Combine::Replace;
    // Z alternates between scratch 0 and `zeroth`, where it is after Dim passes; later components alternate with
    // scratch 3 and add to `zeroth` with their last pass.
    const T* sum = velocity;
    for (int axis = 0; axis < Dim; ++axis) {
      if (!slope_needed[axis].is_empty()) {
        T* out = first + static_cast<std::size_t>(axis) * field_size();
        const bool is_last = axis == Dim - 1;
        T* slope = is_last ? out : scratch(1);
        convolve_axis<Dim, T>(lattice(), axis, rows[axis].slope_transposed, is_last ? combine : Combine::Replace,
                              sum_needed[axis], sum, slope_needed[axis], slope);
        Part part{slope, slope_needed[axis]};
        for (int b = axis + 1; b < Dim; ++b) {
          T* next = b == Dim - 1 ? out : scratch(part.values == scratch(1) ? 2 : 1);
          BlockMask<Dim> next_at = wanted.first[axis];
          for (int above = Dim - 1; above > b; --above) next_at = reach(next_at, above);
          convolve_axis<Dim, T>(lattice(), b, rows[b].value, b == Dim - 1 ? combine : Combine::Replace, part.at,
                                part.values, next_at, next);
          part = {next, next_at};
        }
      }
      if (sum_needed[axis + 1].is_empty()) break;
      const bool is_last = axis == Dim - 1;
      T* next = is_last ? zeroth : (Dim - axis) % 2 == 0 ? scratch(0) : q == 0 ? zeroth : scratch(3);
      convolve_axis<Dim, T>(lattice(), axis, rows[axis].value, is_last ? combine : Combine::Replace, sum_needed[axis],
                            sum, sum_needed[axis + 1], next);
      sum = next;
    }
  }
}

template <int Dim, class T>
double MomentumScale<Dim, T>::penalty(const T* zeroth, const T* first, const MomentumMasks<Dim>& at,
                                      const MomentumMasks<Dim>& wanted, T* zeroth_gradient, T* first_gradient) {
  double energy = 0;
  const auto add = [&](const T* momentum, const BlockMask<Dim>& momentum_at, const BlockMask<Dim>& gradient_at,
                       int curved_axis, T* gradient) {
    if (gradient_at.is_empty()) return;
    const bool is_zeroth = curved_axis < 0;
    std::vector<BlockMask<Dim>> needed(Dim, gradient_at);  // after the pass along an axis
    for (int axis = 1; axis < Dim; ++axis) needed[axis] = reach(needed[axis - 1], axis - 1);
    const bool is_everywhere = is_zeroth && momentum_at.is_all() && gradient_at.is_all();
    if (is_everywhere) smooth(true, momentum, gradient);
    for (std::size_t q = 0; q < components_.size() && !is_everywhere; ++q) {
      const Component& component = components_[q];
      Part part{momentum, momentum_at};
      for (int axis = Dim - 1; axis >= 0; --axis) {
        const bool is_curved = axis == curved_axis;
        const AxisTaps<T>& taps = axis > 0 ? (is_curved ? component.rows[axis].curvature : component.rows[axis].value)
                                  : is_curved ? component.curvature
                                  : is_zeroth ? component.zeroth_gram
                                              : component.first_gram;
        T* out = axis == 0 ? gradient : scratch(part.values == scratch(1) ? 2 : 1);
        BlockMask<Dim> out_at = needed[axis];
        if (axis > 0) out_at &= reach(part.at, axis);
        convolve_axis<Dim, T>(lattice(), axis, taps, axis == 0 && q > 0 ? Combine::Add : Combine::Replace, part.at,
                              part.values, out_at, out);
        part = {out, out_at};
      }
    }
    energy += 0.5 * momentum_at.sum_runs(lattice(), [&](std::size_t begin, std::size_t count) {
      double sum = 0;
      for (std::size_t i = Dim * begin; i < Dim * (begin + count); ++i)
        sum += static_cast<double>(momentum[i]) * gradient[i];
      return sum;
    });
  };
  if (zeroth) add(zeroth, at.zeroth, wanted.zeroth, -1, zeroth_gradient);
  if (first)
    for (int axis = 0; axis < Dim; ++axis) {
      const std::size_t field = static_cast<std::size_t>(axis) * field_size();
      add(first + field, at.first[axis], wanted.first[axis], axis, first_gradient + field);
    }
  return energy;
}

template <int Dim, class T>
double MomentumScale<Dim, T>::penalty_of_velocity(const T* zeroth, const T* velocity, T* zeroth_gradient) const {
  const T volume = static_cast<T>(lattice().cell_volume());
  return 0.5 * BlockMask<Dim>::all(lattice()).sum_runs(lattice(), [&](std::size_t begin, std::size_t count) {
    double sum = 0;
    for (std::size_t i = Dim * begin; i < Dim * (begin + count); ++i) {
      zeroth_gradient[i] = volume * velocity[i];
      sum += static_cast<double>(zeroth[i]) * zeroth_gradient[i];
    }
    return sum;
  });
}

template <int Dim, class T>
double MomentumScale<Dim, T>::total_energy(const T* zeroth, const T* first) {
  // Pairs of orders (-1 is order 0), each with its separable kernel: value, slope or curvature along each axis.
  const double ratio = first_order_unit_ / options_.kernel.width();
  Field<T> smoothed(field_size()), next(field_size());
  double twice = 0;
  const auto momentum = [&](int order) {
    return order < 0 ? zeroth : first + static_cast<std::size_t>(order) * field_size();
  };
  const int lowest = zeroth ? -1 : 0, highest = first ? Dim - 1 : -1;
  for (const Component& component : components_)
    for (int left = lowest; left <= highest; ++left)
      for (int right = lowest; right <= highest; ++right) {
        const T* source = momentum(right);
        std::copy(source, source + field_size(), smoothed.begin());
        double factor = lattice().cell_volume();
        for (int axis = 0; axis < Dim; ++axis) {
          const Rows& rows = component.rows[axis];
          const bool by_left = left == axis, by_right = right == axis;
          const AxisTaps<T>& taps = by_left && by_right ? rows.curvature
                                    : by_right          ? rows.slope_gram
                                    : by_left           ? rows.slope_gram_transposed
                                                        : rows.value;
          if (by_left && by_right) factor *= ratio * ratio;
          convolve_axis<Dim, T>(lattice(), Dim, axis, taps, Combine::Replace, smoothed.data(), next.data());
          std::swap(smoothed, next);
        }
        const T* target = momentum(left);
        twice += factor * ordered_sum(field_size(), [&](std::size_t i) { return double(target[i]) * smoothed[i]; });
      }
  return twice / 2;
}

template <int Dim, class T>
double MomentumScale<Dim, T>::first_order_stiffness(int axis) const {
  return options_.first_weight * lattice().cell_volume() * curvature_at_zero_[axis];
}

template class MomentumScale<2, float>;
template class MomentumScale<3, float>;
template class MomentumScale<2, double>;
template class MomentumScale<3, double>;

}  // namespace saltus
