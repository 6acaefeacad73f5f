#pragma once

#include "core/flow/evolution.h"
#include "core/grid/block_mask.h"

#include <Eigen/Core>

#include <vector>

namespace saltus {

/// The sites of a lattice after a displacement d of them (mm, interleaved): F = D phi at each, jump-aware
/// (jump_aware_jacobian.h), and the adjoint of that. Scales that share a lattice share this.
///
/// With evolution `carried` F is the identity and costs nothing. Not for concurrent use; threads inside.
template <int Dim, class T>
class MovedSites {
 public:
  using Matrix = Eigen::Matrix<T, Dim, Dim, Eigen::RowMajor | Eigen::DontAlign>;

  MovedSites(const Lattice<Dim>& lattice, Evolution evolution);

  const Lattice<Dim>& lattice() const { return lattice_; }
  const std::array<std::size_t, Dim>& strides() const { return stride_; }
  const std::array<double, Dim>& per_mm() const { return per_mm_; }  ///< samples a mm, by axis
  const T* displacement() const { return displacement_; }

  /// Finds F for the sites in `where`; F is right at those whose neighbours are in there too, or do not exist.
  /// `displacement` must outlive the use of this.
  void move(const T* displacement, const BlockMask<Dim>& where);
  void move(const T* displacement) { move(displacement, BlockMask<Dim>::all(lattice_)); }

  bool has_jacobians() const { return !jacobian_.empty(); }
  const T* jacobians() const { return jacobian_.data(); }  ///< F per site, row-major
  Matrix inverse_jacobian(std::size_t site) const;

  /// Between these two, duals of F in `where` are added to jacobian_duals(); the end brings them to the displacement.
  void begin_adjoint(const BlockMask<Dim>& where);
  T* jacobian_duals() { return jacobian_dual_.data(); }
  void end_adjoint(const BlockMask<Dim>& where, T* displacement_dual);

 private:
  Lattice<Dim> lattice_;
  std::array<std::size_t, Dim> stride_;
  std::array<double, Dim> per_mm_;
  const T* displacement_ = nullptr;
  std::vector<T> jacobian_, jacobian_dual_;
};

}  // namespace saltus
