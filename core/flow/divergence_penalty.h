#pragma once

#include "core/grid/lattice.h"

namespace saltus {

/// factor/2 * integral of |div v|^2 over the lattice, for an interleaved velocity (mm per unit time); the gradient is
/// added to `dual`. The divergence is taken at the centres of cells, from the velocity at their corners.
///
/// A geodesic bends: momentum in a shear layer gains a component normal to it (m' = F^-T m), which no image can show
/// when its level lines cross the layer. A tangential jump has no divergence, so this term leaves sliding free and
/// holds back opening, overlap and that drift.
template <int Dim, class T>
double add_divergence_penalty(const Lattice<Dim>& lattice, const T* velocity, double factor, T* dual);

}  // namespace saltus
