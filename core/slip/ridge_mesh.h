#pragma once

#include "core/slip/jump_density.h"

#include <array>
#include <vector>

namespace saltus {

/// A surface of lines (2-D) or triangles (3-D), in the frame.
template <int Dim>
struct RidgeMesh {
  struct Facet {
    std::array<int, Dim> corners;
    std::size_t cell = 0;  ///< of the density's lattice: facets of one cell lie together and rise with it
  };
  std::vector<Vector<Dim>> vertices;
  std::vector<Facet> facets;
};

/// Where a jump density is largest across itself: with rho and n the first singular value and right vector of B, the
/// surface n . grad rho = 0 on which that falls along n. Cut out of the simplices that every cell is divided into, with
/// signs of n that agree within a simplex and vertices that neighbours share, so that the surface is closed but for its
/// rim. Where rho is below half of what a sheet with a jump of `least_jump_mm` has there is no surface, nor where the
/// directions around do not agree (two sheets that meet).
template <int Dim>
RidgeMesh<Dim> ridge_mesh(const JumpDensity<Dim>& density, double least_jump_mm);

/// Area of a facet times its unit normal, of either sign.
template <int Dim>
Vector<Dim> area_vector(const RidgeMesh<Dim>& mesh, const typename RidgeMesh<Dim>::Facet& facet);

}  // namespace saltus
