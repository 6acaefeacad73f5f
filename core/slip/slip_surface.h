#pragma once

#include "core/grid/image_grid.h"

#include <cstddef>
#include <vector>

namespace saltus {

/// A piece of the surface along which the motion slides, about a sample wide, in the fixed image; world mm (LPS).
/// The side that `normal` points to is +, the other -.
template <int Dim>
struct SlipPoint {
  Vector<Dim> position = Vector<Dim>::Zero();
  Vector<Dim> normal = Vector<Dim>::Zero();  ///< unit; consistent within a connected part
  double area = 0;                           ///< mm^(Dim-1): in 2-D a length
  /// u+ - u-, of which the part along the normal is taken away: the tangential jump of the displacement.
  Vector<Dim> jump = Vector<Dim>::Zero();
  /// By how much the two sides, carried to the moving image, come apart there, mm: negative where they overlap.
  double gap_mm = 0;
  double velocity_jump_mm = 0;  ///< |[v(0)]| that the momenta make here: by how much the motion sets out to jump
  int part = 0;                 ///< connected parts, the largest is 0
};

template <int Dim>
struct SlipSurface {
  std::vector<SlipPoint<Dim>> points;  ///< empty: nothing slides
  double least_jump_mm = 0;            ///< jumps below this are left out
};

/// Figures of a whole surface, each point counted with its area; all 0 for an empty one.
struct SlipSummary {
  double area = 0;  ///< mm^(Dim-1)
  int parts = 0;
  double jump_mean_mm = 0, jump_p95_mm = 0, jump_max_mm = 0;  ///< tangential
  double gap_p95_mm = 0, overlap_p95_mm = 0;  ///< of max(0, gap) and of max(0, -gap), both positive numbers
};

template <int Dim>
SlipSummary summarise(const SlipSurface<Dim>& surface);

}  // namespace saltus
