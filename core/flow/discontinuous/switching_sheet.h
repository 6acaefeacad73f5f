#pragma once

#include "core/flow/discontinuous/piecewise_velocity.h"
#include "core/momenta/momentum_scale.h"

#include <vector>

namespace saltus {

/// A sample counts for a side when it lies at least this many samples from the sheet on it. Samples beside a sheet on
/// a face lie half a sample from it; one that is nearer holds a mixture of both sides.
constexpr double kCleanDistance = 0.45;

/// A switching surface of a sampled velocity: the height along one axis of the lattice over columns of the others,
///
///     H(t, x) = x_axis - height(t, x_others)
///
/// known at each time node, linear in between, in time and from column to column.
template <int Dim>
class SwitchingSheet {
 public:
  int axis = 0;
  Lattice<Dim> lattice;                    ///< of the velocity
  Index<Dim> low{};                        ///< lowest column; 0 along `axis`
  Index<Dim> size{};                       ///< number of columns; 1 along `axis`
  double clean_distance = kCleanDistance;  ///< samples along `axis` from which on a sample is of one side alone
  struct Column {
    float height = 0;    ///< mm in the frame
    float coverage = 0;  ///< share of the column that the sheet covers, 0 to 1; below 1/2 it is not there
    bool is_known = false;
  };
  std::vector<std::vector<Column>> nodes;  ///< columns at each time node, x fastest

  /// Column at a lattice index, or null outside.
  const Column* column(int node, const Index<Dim>& index) const;
  /// At share s of the way from `node` to the next.
  SurfaceJet<Dim> jet(int node, double share, double node_spacing, const Vector<Dim>& x) const;

 private:
  std::size_t place(const Index<Dim>& index) const;
};

struct SwitchingSheetOptions {
  /// A face switches where its first-order momentum makes v jump by at least this many samples per unit time.
  double least_jump_samples = 0.1;
};

/// The sheets that the first-order momenta of a scale make, followed through the flow. A face along axis i at which
/// m_i, smoothed along the other axes, makes a large enough jump
///
///     [v] = a_1 sigma/mass (k0(h) - 2 k0(0) + k0(-h)) (K_others * m_i)     (-4 a_1 h / mass m_i where m_i is wide)
///
/// belongs to a sheet with its neighbours; neighbouring columns may differ by one sample. Faces move with the mean of
/// the sites beside them, as coadjoint_transport.h moves their momenta.
/// Empty when the scale's kernel is smooth at 0, or its lattice is not that of the velocity (interpolation from a
/// coarser lattice makes a jump a ramp). `velocities`: v(t_k) at equally spaced nodes over [0,1].
template <int Dim, class T>
std::vector<SwitchingSheet<Dim>> find_switching_sheets(const MomentumScale<Dim, T>& scale, const T* first,
                                                       const Lattice<Dim>& velocity_lattice,
                                                       const std::vector<Field<T>>& velocities,
                                                       const SwitchingSheetOptions& options = {});

}  // namespace saltus
