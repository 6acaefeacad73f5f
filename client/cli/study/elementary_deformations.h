#pragma once

#include "client/cli/study/figure.h"
#include "core/grid/volume.h"

#include <string>
#include <vector>

namespace saltus::cli {

/// What one momentum at one place does.
struct ElementaryDeformation {
  std::string name;
  VectorVolume<2> displacement;  ///< phi_1(y) - y, mm, on a square grid around the momentum
};

/// The three of the paper's first figure, by shooting a single momentum along x from the middle: Gaussian order 0
/// translates, Gaussian order 1 along y shears, C0 Wendland order 1 along y slides. Momenta are carried along as they
/// are (Evolution::Carried), as registrations do. Each is so long that its initial velocity is at most `largest_mm`.
std::vector<ElementaryDeformation> elementary_deformations(double gaussian_mm, double wendland_mm, double largest_mm);

/// Their deformed grids, side by side.
Figure elementary_figure();

}  // namespace saltus::cli
