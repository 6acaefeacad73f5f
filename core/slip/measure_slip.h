#pragma once

#include "core/grid/volume.h"
#include "core/slip/jump_elements.h"
#include "core/slip/slip_surface.h"

#include <vector>

namespace saltus {

struct SlipSurfaceOptions {
  /// v(0) and u have to jump by at least this many samples of the density's lattice, and by this share of the largest
  /// jump of v(0).
  double least_jump_samples = 0.1;
  double least_share = 0.1;
};

/// A flow and the map that was made of it.
template <int Dim>
struct SlipFlow {
  const Lattice<Dim>& lattice;                  ///< of the velocities
  const std::vector<Field<float>>& velocities;  ///< v(t_k) at equally spaced nodes over [0,1]
  const ImageGrid<Dim>& fixed;                  ///< its axes and voxel 0 are the frame
  const Field<float>& backward;                 ///< psi(x) - x at its voxels, in the frame
  const AffineMap<Dim>& start;                  ///< fixed world -> moving world, after psi
  const ImageGrid<Dim>& moving;
};

/// The surface along which a motion slides, from the momenta that make it and the displacement that came of them:
///
///  1. The ridge of the jump density of the momenta at t = 0 (jump_density.h, ridge_mesh.h), in pieces of one cell.
///  2. Its vertices are carried to the fixed image by phi_1. Within the transition of a jump the velocity is the mean
///     of both sides, as it is for the momenta themselves.
///  3. Each side of u is a line fitted to its samples from kNearest to kFarthest samples off the surface along the
///     normal, taken at the surface: what the smooth part changes over that distance is no jump, and the transition
///     (sampling, cell averages, momenta on neighbouring sites) is left out. That is exact for the jump of a C0
///     Wendland kernel, whose velocity is linear on either side, as long as no other sheet is as near as kFarthest.
///  4. A connected part is left out where images do not tell most of it: where a side has fewer than half of its
///     samples in the fixed image's grid and, carried along, in the moving one's (masks are not asked). Beside an
///     image's end momenta may jump as they like.
///  5. The gap is the distance of the + side's piece, carried by u+, from the plane through the - side's pieces around
///     the nearest one, carried by u-: a jump along a curved surface has a part along its normal and opens nothing.
///
/// Samples beyond the image are those of its border, and a rim is continued by the plane of its last pieces.
template <int Dim>
SlipSurface<Dim> measure_slip(const std::vector<JumpElements<Dim>>& elements, const SlipFlow<Dim>& flow,
                              const SlipSurfaceOptions& options = {});

}  // namespace saltus
