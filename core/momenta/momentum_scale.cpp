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
  const bool zeroth = has_zeroth(options.orders);
  channel_weight_ = zeroth ? options.zeroth_weight : options.first_weight;
  const double ratio = options.first_weight / channel_weight_, width = options.kernel.width();
  first_order_unit_ = ratio * width;
  curvature_at_zero_.fill(0);
  for (const KernelComponent& kernel : kernels) {
    const double unit = width / kernel.profile->width();
    Component component;
    for (int axis = 0; axis < Dim; ++axis) {
      const KernelTaps taps = cell_averaged_taps(*kernel.profile, options.lattice.spacing[axis]);
      curvature_at_zero_[axis] += kernel.weight * unit * unit * taps.curvature[static_cast<std::size_t>(taps.radius)];
      // Whatever is made of a component passes once along x, so the weight sits there.
      component.emplace_back(taps, axis == 0 ? kernel.weight : 1.0, unit, ratio);
      const Rows& rows = component.back();
      for (const AxisTaps<T>* row : {&rows.value, &rows.slope, &rows.curvature})
        radius_[axis] = std::max(radius_[axis], row->radius());
    }
    components_.push_back(std::move(component));
  }
  for (int k = 0; k < (components_.size() > 1 ? 4 : 3); ++k) scratch_[k].resize(field_size());
  if (!options.normals.empty())
    oriented_ = std::make_unique<OrientedMomenta<Dim, T>>(
        OrientedOptions<Dim>{options.lattice, options.normals, width, options.first_weight, options.oriented_spacing});
}

template <int Dim, class T>
MomentumMasks<Dim> MomentumScale<Dim, T>::everywhere() const {
  const auto all = BlockMask<Dim>::all(lattice()), none = BlockMask<Dim>::none(lattice());
  return MomentumMasks<Dim>(has_zeroth(options_.orders) ? all : none, has_first_order() ? all : none);
}

/// Convolves with the kernel along all axes above `axis`; the result is in scratch 1 or 2, or `part` itself.
template <int Dim, class T>
auto MomentumScale<Dim, T>::smooth_axes_above(const Component& rows, int axis, Part part) -> Part {
  for (int above = Dim - 1; above > axis; --above) {
    T* out = scratch_[part.values == scratch_[1].data() ? 2 : 1].data();
    const BlockMask<Dim> out_at = reach(part.at, above);
    convolve_axis<Dim, T>(lattice(), above, rows[above].value, Combine::Replace, part.at, part.values, out_at, out);
    part = {out, out_at};
  }
  return part;
}

template <int Dim, class T>
BlockMask<Dim> MomentumScale<Dim, T>::synthesise(const T* zeroth, const T* first, const MomentumMasks<Dim>& at,
                                                 T* velocity) {
  const auto none = BlockMask<Dim>::none(lattice());
  BlockMask<Dim> reached = none;
  for (std::size_t q = 0; q < components_.size(); ++q) {
    const Component& rows = components_[q];
    // One sweep over the axes, last to first: Z <- K_a Z + D_a (product of K_b, b > a) m_a. Z alternates between
    // scratch 0 and `velocity`, where it ends; later components only add to `velocity`, at the end.
    Part sum{zeroth, zeroth ? at.zeroth : none};
    for (int axis = Dim - 1; axis >= 0; --axis) {
      Part slopes{nullptr, none};
      if (first && !at.first[axis].is_empty())
        slopes = smooth_axes_above(rows, axis, {first + static_cast<std::size_t>(axis) * field_size(), at.first[axis]});
      const BlockMask<Dim> slopes_at = reach(slopes.at, axis);
      BlockMask<Dim> out_at = reach(sum.at, axis);
      out_at |= slopes_at;
      T* out = axis == 0 ? velocity : axis == 1 ? scratch_[0].data() : q == 0 ? velocity : scratch_[3].data();
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
  const T weight = static_cast<T>(channel_weight_);
  reached.for_runs(lattice(), [&](std::size_t begin, std::size_t count) {
    for (std::size_t i = Dim * begin; i < Dim * (begin + count); ++i) velocity[i] *= weight;
  });
  return reached;
}

template <int Dim, class T>
void MomentumScale<Dim, T>::synthesise_transpose(const T* velocity, const MomentumMasks<Dim>& wanted, T* zeroth,
                                                 T* first) {
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
  const T weight = static_cast<T>(channel_weight_);
  for (std::size_t q = 0; q < components_.size(); ++q) {
    const Component& rows = components_[q];
    const Combine combine = q > 0 ? Combine::Add : Combine::Replace;
    // Z alternates between scratch 0 and `zeroth`, where it is after Dim passes; later components alternate with
    // scratch 3 and add to `zeroth` with their last pass.
    T* other = q == 0 ? zeroth : scratch_[3].data();
    T* scaled = Dim % 2 == 0 ? other : scratch_[0].data();
    sum_needed[0].for_runs(lattice(), [&](std::size_t begin, std::size_t count) {
      for (std::size_t i = Dim * begin; i < Dim * (begin + count); ++i) scaled[i] = weight * velocity[i];
    });
    const T* sum = scaled;
    for (int axis = 0; axis < Dim; ++axis) {
      if (!slope_needed[axis].is_empty()) {
        T* out = first + static_cast<std::size_t>(axis) * field_size();
        const bool is_last = axis == Dim - 1;
        T* slope = is_last ? out : scratch_[1].data();
        convolve_axis<Dim, T>(lattice(), axis, rows[axis].slope_transposed, is_last ? combine : Combine::Replace,
                              sum_needed[axis], sum, slope_needed[axis], slope);
        Part part{slope, slope_needed[axis]};
        for (int b = axis + 1; b < Dim; ++b) {
          T* next = b == Dim - 1 ? out : scratch_[part.values == scratch_[1].data() ? 2 : 1].data();
          BlockMask<Dim> next_at = wanted.first[axis];
          for (int above = Dim - 1; above > b; --above) next_at = reach(next_at, above);
          convolve_axis<Dim, T>(lattice(), b, rows[b].value, b == Dim - 1 ? combine : Combine::Replace, part.at,
                                part.values, next_at, next);
          part = {next, next_at};
        }
      }
      if (sum_needed[axis + 1].is_empty()) break;
      const bool is_last = axis == Dim - 1;
      T* next = is_last ? zeroth : sum == other ? scratch_[0].data() : other;
      convolve_axis<Dim, T>(lattice(), axis, rows[axis].value, is_last ? combine : Combine::Replace, sum_needed[axis],
                            sum, sum_needed[axis + 1], next);
      sum = next;
    }
  }
}

template <int Dim, class T>
double MomentumScale<Dim, T>::penalty(const T* zeroth, const T* first, const MomentumMasks<Dim>& at,
                                      const MomentumMasks<Dim>& wanted, T* zeroth_gradient, T* first_gradient) {
  const double volume = lattice().cell_volume();
  double energy = 0;
  const auto add = [&](const T* momentum, const BlockMask<Dim>& momentum_at, const BlockMask<Dim>& gradient_at,
                       int curved_axis, double weight, T* gradient) {
    if (gradient_at.is_empty()) return;
    std::vector<BlockMask<Dim>> needed(Dim, gradient_at);  // after the pass along an axis
    for (int axis = 1; axis < Dim; ++axis) needed[axis] = reach(needed[axis - 1], axis - 1);
    for (std::size_t q = 0; q < components_.size(); ++q) {
      Part part{momentum, momentum_at};
      for (int axis = Dim - 1; axis >= 0; --axis) {
        const Rows& rows = components_[q][axis];
        T* out = axis == 0 ? gradient : scratch_[part.values == scratch_[1].data() ? 2 : 1].data();
        BlockMask<Dim> out_at = needed[axis];
        if (axis > 0) out_at &= reach(part.at, axis);
        convolve_axis<Dim, T>(lattice(), axis, axis == curved_axis ? rows.curvature : rows.value,
                              axis == 0 && q > 0 ? Combine::Add : Combine::Replace, part.at, part.values, out_at, out);
        part = {out, out_at};
      }
    }
    const T factor = static_cast<T>(weight * volume);
    gradient_at.for_runs(lattice(), [&](std::size_t begin, std::size_t count) {
      for (std::size_t i = Dim * begin; i < Dim * (begin + count); ++i) gradient[i] *= factor;
    });
    energy += 0.5 * momentum_at.sum_runs(lattice(), [&](std::size_t begin, std::size_t count) {
      double sum = 0;
      for (std::size_t i = Dim * begin; i < Dim * (begin + count); ++i)
        sum += static_cast<double>(momentum[i]) * gradient[i];
      return sum;
    });
  };
  if (zeroth) add(zeroth, at.zeroth, wanted.zeroth, -1, options_.zeroth_weight, zeroth_gradient);
  if (first)
    for (int axis = 0; axis < Dim; ++axis) {
      const std::size_t field = static_cast<std::size_t>(axis) * field_size();
      add(first + field, at.first[axis], wanted.first[axis], axis, options_.first_weight, first_gradient + field);
    }
  return energy;
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
        double factor = channel_weight_ * lattice().cell_volume();
        for (int axis = 0; axis < Dim; ++axis) {
          const Rows& rows = component[axis];
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
