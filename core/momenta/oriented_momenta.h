#pragma once

#include "core/grid/lattice.h"
#include "core/kernels/averaged_wendland.h"
#include "core/momenta/transported_element.h"

#include <Eigen/Core>

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace saltus {

/// What oriented momenta are made of.
template <int Dim>
struct OrientedOptions {
  Lattice<Dim> lattice;
  std::vector<Eigen::Matrix<double, Dim, 1>> normals;  ///< in the frame
  double width_mm = 1;                                 ///< sigma of the C0 Wendland profiles in the plane
  double weight = 1;                                   ///< a_1 = 1 / (weight of 1/2 ||v||^2)
  /// Of elements beside each other in their plane, in sites; along axes whose sites are so far apart that half a width
  /// holds fewer, as many as it holds.
  int spacing = 1;
  double normal_share = 1;  ///< of width_mm, sigma of the profile along n

  double normal_width_mm() const { return normal_share * width_mm; }
};

/// How far apart elements are along each axis, in sites: the spacing, and no further than half a width.
template <int Dim>
Index<Dim> sites_apart(const Lattice<Dim>& lattice, double width_mm, int spacing);

/// How many sites have room for an element, whatever its normal: multiples of what `sites_apart` says along all axes
/// but one.
template <int Dim>
std::size_t sites_with_room(const Lattice<Dim>& lattice, double width_mm, int spacing);

/// First-order momenta with the derivative along a normal n and a kernel that is turned with it (numerics, section 7):
///
///     v(x) = a_1 V sum over elements e of m_e S(n_e . (x - x_e)) product over j of V(t_ej . (x - x_e)),
///
/// with V the cell volume, S and V the averaged profiles of averaged_wendland.h (cells as wide as a site of the lattice
/// is along that direction, in the plane as many of them as elements are apart), t_ej the frame's other axes. A layer
/// of them jumps by as much as one of axis-aligned momenta m_i of the same size and width along their axis, whatever
/// way n points.
///
/// An *element* is a pair (normal, site), numbered normal * sites + site; only those that a caller lists exist, so
/// that all costs follow their number. Its momentum lies in its plane, m_e = sum_j c_ej t_ej: it can only slide, and
/// Dim - 1 values c_ej are stored. With evolution `carried` it goes as the Dim corners of a small simplex in its plane,
/// whose middle is x_e: so the plane turns with the flow and is never told by a derivative across the jump. The
/// simplex's first axis is t_e1.
///
/// Not for concurrent use: holds scratch memory. Threads inside (OpenMP); results do not depend on their number. What
/// visits the sites around elements is in oriented_synthesis.cpp and transported_synthesis.cpp, what turns them in
/// oriented_turning.cpp.
template <int Dim, class T>
class OrientedMomenta {
 public:
  static constexpr int kComponents = Dim - 1;      ///< values of an element's momentum
  static constexpr int kCornerValues = Dim * Dim;  ///< coordinates of its corners, corner by corner, in mm of the frame
  using Element = std::uint32_t;

  /// Throws InvalidInput when a normal is no unit vector, the spacing is below 1, the share not above 0, or there are
  /// more elements than numbers for them.
  explicit OrientedMomenta(const OrientedOptions<Dim>& options);

  const OrientedOptions<Dim>& options() const { return options_; }
  const Lattice<Dim>& lattice() const { return options_.lattice; }
  std::size_t elements() const { return options_.normals.size() * sites_; }  ///< that there can be
  std::size_t site_of(Element element) const { return element % sites_; }
  std::size_t normal_of(Element element) const { return element / sites_; }

  /// Turns elements: at each site one has the normal that `normals` says (Dim values a site, unit or 0 for none, either
  /// sign) from now on, by the least rotation. It is one whose own normal is near (the nearest where none is), and few
  /// of these serve many sites, since the penalty knows no pairs of two normals. `active` elements (rising) that are
  /// turned remain the ones of their sites, and keep their normal where the new one is none or far from it. All others
  /// have those of the options.
  void turn(std::vector<T> normals, const std::vector<Element>& active = {});
  /// Puts back what `turned_normals` and `turned` said.
  void restore_turned(std::vector<T> normals, std::vector<Element> turned);
  /// How often that was done.
  std::size_t turns() const { return turns_; }
  /// The elements that were turned, rising.
  const std::vector<Element>& turned() const { return turned_; }
  /// Those of them that have room: at sites that are multiples of the spacing along all axes but the steepest of the
  /// options' normal, so that neighbours agree which that is.
  const std::vector<Element>& candidates() const { return candidates_; }
  /// Of the elements that were turned, by site, with signs as they are used; empty before.
  const std::vector<T>& turned_normals() const { return turned_normals_; }

  /// The axis along which a plane with this normal of the options is left in the fewest sites.
  int steepest_axis(std::size_t normal) const { return orientations_[normal].steepest; }
  /// Sites of its plane that a candidate with this normal stands for.
  double sites_of_each(std::size_t normal) const;

  /// Corners of elements at time 0, kCornerValues each.
  void place(const std::vector<Element>& elements, std::vector<T>& corners) const;

  /// velocity += that of elements with these normals (normal_of), corners and momenta; the velocity lies on the
  /// lattice. Elements whose momentum is 0 cost nothing.
  void add_velocity(const std::vector<Element>& elements, const T* corners, const T* momenta, T* velocity) const;

  /// Its transpose and derivative: from the dual of the velocity, adds to the duals of the momenta and, where the
  /// momentum is not 0, of the corners (null: not).
  void add_velocity_adjoint(const std::vector<Element>& elements, const T* corners, const T* momenta,
                            const T* velocity_dual, T* momenta_dual, T* corners_dual) const;

  /// 1/2 sum over normals of ||v||^2 at time 0; adds its gradient to those of the momenta. The block form: normals know
  /// nothing of each other, and a turned element counts as one that was not. `elements` must rise.
  double penalty(const std::vector<Element>& elements, const T* momenta, T* gradient) const;

  /// As MomentumScale::first_order_stiffness: a_1 V c, the same for all normals where samples are cubes.
  double stiffness(std::size_t normal) const;

  // Elements that a flow has transported as momenta, not as things (all evolutions but `carried`, see
  // element_transport.h). Their kernel stays turned as it was at time 0, when they had the momenta `at_start`: those
  // that had none make nothing.

  /// velocity += a_1 V sum over e of m_0 P + sigma m_1 (N . grad) P at x - at, P the product of averaged values, sigma
  /// that along n.
  void add_transported(const std::vector<Element>& elements, const std::vector<TransportedElement<Dim, T>>& transported,
                       const T* at_start, T* velocity) const;
  /// Its transpose and derivative: duals of m_0 and m_1 and, if it `moves` and had a momentum, of N and the position.
  void add_transported_adjoint(const std::vector<Element>& elements,
                               const std::vector<TransportedElement<Dim, T>>& transported, const T* at_start,
                               const T* velocity_dual, bool moves,
                               std::vector<TransportedElement<Dim, T>>& duals) const;
  /// Sum over normals of 1/2 (rho | K_n rho), where K_n is turned as the options' normal n: of elements that are not
  /// turned, at time 0 the penalty. For tests: takes the square of the number of elements.
  double energy(const std::vector<Element>& elements, const std::vector<TransportedElement<Dim, T>>& transported) const;

  using Placement = ElementPlacement<Dim, T>;
  /// Of an element from its corners.
  static Placement placement(const T* corners);

 private:
  /// What all elements with one normal have in common.
  struct Orientation {
    Eigen::Matrix<double, Dim, Dim> axes;  ///< at time 0
    AveragedWendland<T> profiles[Dim];     ///< along them
    int steepest = 0;                      ///< see steepest_axis
    Index<Dim> reach;                      ///< of `gram`, in sites
    std::size_t row_of_taps = 0;           ///< of `gram`, what is more than 2 reach[0] + 1 of them is 0
    std::vector<T> gram;                   ///< of two elements by how far their sites are apart
    std::array<T, Dim> reaches() const {   ///< of the profiles, mm
      std::array<T, Dim> found;
      for (std::size_t k = 0; k < Dim; ++k) found[k] = profiles[k].reach();
      return found;
    }
  };
  bool has_room(Element element) const;
  static T shape_scale(const Orientation& orientation);
  void add_forces(const Orientation& orientation, std::span<const Index<Dim>> sites, const T* momenta, T* forces) const;
  struct Pull {
    Eigen::Matrix<T, Dim, 1> pulled, force;
    Eigen::Matrix<T, Dim, Dim> turning;
  };
  template <bool Moves>
  TransportedElement<Dim, T> transported_dual(const Orientation& orientation,
                                              const TransportedElement<Dim, T>& one) const;
  template <bool Moves>
  Pull pull(const Orientation& orientation, const Placement& place, const Eigen::Matrix<T, Dim, 1>& vector) const;

  OrientedOptions<Dim> options_;
  std::size_t sites_;
  Index<Dim> apart_;  ///< see sites_apart
  std::vector<Orientation> orientations_;
  std::vector<T> turned_normals_;
  std::vector<Element> turned_, candidates_;
  std::size_t turns_ = 0;
  mutable std::vector<T> by_component_;  ///< of a PaddedField
  struct PenaltyScratch {
    std::vector<T> forces;
    std::vector<Index<Dim>> sites;
    std::vector<std::vector<T>> planes;  ///< one for each thread, 0 between two calls
  };
  mutable PenaltyScratch penalty_;
};

}  // namespace saltus
