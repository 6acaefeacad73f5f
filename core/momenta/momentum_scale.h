#pragma once

#include "core/grid/block_mask.h"
#include "core/grid/lattice.h"
#include "core/kernels/axis_taps.h"
#include "core/kernels/kernel_sum.h"
#include "core/momenta/block_set.h"
#include "core/momenta/oriented_momenta.h"

#include <memory>
#include <vector>

namespace saltus {

/// The orders that a scale's initial momentum has. `Oriented`: oriented momenta alone, which need no fields.
enum class Orders { Zeroth, First, ZerothAndFirst, Oriented };

inline bool has_zeroth(Orders orders) { return orders == Orders::Zeroth || orders == Orders::ZerothAndFirst; }
/// Along the axes.
inline bool has_first(Orders orders) { return orders == Orders::First || orders == Orders::ZerothAndFirst; }

/// What a scale is made of.
template <int Dim>
struct MomentumScaleOptions {
  KernelSum kernel;
  Lattice<Dim> lattice;
  Orders orders = Orders::Zeroth;
  double zeroth_weight = 1;  ///< a_0 = 1 / (weight of 1/2 ||v_0||^2)
  double first_weight = 1;   ///< a_1 = 1 / (weight of 1/2 ||v_i||^2)
  /// Unit vectors w, Dim components a site (see directional_momentum.h): who optimises first orders then has one field
  /// m_w and expands it. Empty: one field for each axis. The scale itself always sees the Dim fields.
  Field<double> direction = {};
  /// Normals of oriented momenta (oriented_momenta.h) of the kernel's width and with the weight a_1. Empty: there are
  /// none.
  std::vector<Eigen::Matrix<double, Dim, 1>> normals = {};
  int oriented_spacing = 1;          ///< of what has these normals, see OrientedOptions
  double oriented_normal_share = 1;  ///< of the kernel's width that theirs has along the normal
};

/// Momenta of one kernel on one lattice, as cell averages, and the velocity they make:
///
///     v = a_0 K * m_0 + a_1 sigma sum_i D^i K * m_i       (K with unit mass; Bao et al., eq. 3.5)
///
/// K may be a weighted sum of several widths; sigma is KernelSum::width. Costs below are for one component.
///
/// A field of order 0 is interleaved (Dim values a site); order 1 is Dim such fields, one for each derivative axis. The
/// field m_i is staggered: its value at a site belongs to the face half a sample up axis i, where it makes a jump.
/// With unit-mass kernels all momenta are comparable to velocities (mm): v is about a_0 m_0 where m_0 is smooth, and a
/// sheet of m_i one face thick makes a jump of -4 a_1 h / mass times it, with no sample inside (C0 Wendland).
/// Not for concurrent use: holds scratch memory. Threads inside (OpenMP).
template <int Dim, class T>
class MomentumScale {
 public:
  explicit MomentumScale(const MomentumScaleOptions<Dim>& options);

  const MomentumScaleOptions<Dim>& options() const { return options_; }
  const Lattice<Dim>& lattice() const { return options_.lattice; }
  bool has_first_order() const { return has_first(options_.orders); }  ///< along the axes
  bool has_fields() const { return has_first_order() || has_zeroth(options_.orders); }
  /// Whether what it makes may jump: it has first orders of either kind.
  bool can_slide() const { return has_first_order() || oriented_; }
  /// Null where the options have no normals. They have a velocity and a penalty of their own: nothing below knows them.
  OrientedMomenta<Dim, T>* oriented() const { return oriented_.get(); }
  /// Values of one order-0 field, and of one of the Dim order-1 fields.
  std::size_t field_size() const { return Dim * options_.lattice.sites(); }

  /// sigma * a_1 / a_0: what one unit of first-order momentum is worth as a derivative of order-0 momentum.
  double first_order_unit() const { return first_order_unit_; }
  /// a_0 (a_1 where there is no order 0): the factor of the order-0 channel.
  double channel_weight() const { return channel_weight_; }

  /// All fields in all blocks, as far as the scale has them.
  MomentumMasks<Dim> everywhere() const;

  /// velocity = (from order 0) + (from order 1). `first` holds Dim fields one after the other; either may be null.
  /// Momenta are 0 outside `at`; velocity is written where they reach, and that is returned: everywhere, where order 0
  /// is everywhere. 3 passes in 3-D for order 0 alone, 9 with order 1, each over the blocks that it can reach.
  BlockMask<Dim> synthesise(const T* zeroth, const T* first, const MomentumMasks<Dim>& at, T* velocity);
  void synthesise(const T* zeroth, const T* first, T* velocity) { synthesise(zeroth, first, everywhere(), velocity); }
  /// Exact transpose of synthesise, worth something in `wanted` only. `zeroth` is scratch as well and never null;
  /// `first` may be null. No two of them overlap.
  void synthesise_transpose(const T* velocity, const MomentumMasks<Dim>& wanted, T* zeroth, T* first);
  void synthesise_transpose(const T* velocity, T* zeroth, T* first) {
    synthesise_transpose(velocity, everywhere(), zeroth, first);
  }

  /// weights * gram: a_0 V K m_0 and a_1 V (-sigma^2 D^i D^i K) m_i with V the cell volume, the gradient of the penalty
  /// 1/2 sum_i ||v_i||^2. Returns that penalty. Momenta are 0 outside `at`; gradients are written in `wanted`, which
  /// has to hold `at`.
  double penalty(const T* zeroth, const T* first, const MomentumMasks<Dim>& at, const MomentumMasks<Dim>& wanted,
                 T* zeroth_gradient, T* first_gradient);
  double penalty(const T* zeroth, const T* first, T* zeroth_gradient, T* first_gradient) {
    return penalty(zeroth, first, everywhere(), everywhere(), zeroth_gradient, first_gradient);
  }
  /// The same for a scale of order 0 alone, of the velocity that synthesise made of all of its momenta: without a pass.
  double penalty_of_velocity(const T* zeroth, const T* velocity, T* zeroth_gradient) const;

  /// 1/2 (rho | K rho) for the total element rho = m_0 + unit sum_b d_b m_b, cross terms between the orders included.
  double total_energy(const T* zeroth, const T* first);

  /// Diagonal of the order-1 Gram matrix for momenta that vary only along their derivative axis, a_1 V c.
  double first_order_stiffness(int axis) const;

 private:
  struct Rows {
    AxisTaps<T> value, slope, slope_transposed, curvature, slope_gram, slope_gram_transposed;
    /// All taps times `share`, and once for each derivative times `unit`; slopes also times `ratio`, a_1 / a_0.
    Rows(const KernelTaps& taps, double share, double unit, double ratio);
  };
  /// One kernel of the sum. Whatever is made of it passes once along x, so factors of all of it sit in the taps of x:
  /// its weight and channel_weight, and what else the penalty has in rows of its own.
  struct Component {
    std::vector<Rows> rows;             ///< by axis
    AxisTaps<T> zeroth_gram;            ///< rows[0].value, of order 0
    AxisTaps<T> first_gram, curvature;  ///< rows[0].value and rows[0].curvature, of order 1
  };
  /// A field and where it is worth anything.
  struct Part {
    const T* values;
    BlockMask<Dim> at;
  };
  Part smooth_axes_above(const Component& component, int axis, Part part);
  void smooth(bool is_gram, const T* in, T* out);
  T* scratch(int k);
  BlockMask<Dim> reach(const BlockMask<Dim>& mask, int axis) const { return mask.dilated(axis, radius_[axis]); }

  MomentumScaleOptions<Dim> options_;
  double first_order_unit_, channel_weight_;
  std::vector<Component> components_;
  std::array<double, Dim> curvature_at_zero_;
  std::unique_ptr<OrientedMomenta<Dim, T>> oriented_;
  std::array<int, Dim> radius_{};    ///< of the longest row of taps along each axis
  std::array<Field<T>, 4> scratch_;  ///< made when they are needed, see scratch()
};

}  // namespace saltus
