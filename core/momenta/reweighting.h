#pragma once

#include "core/grid/lattice.h"

namespace saltus {

/// |m_i| of `fields` fields (Dim, or one where momenta have a direction of their own), which lie one after the other in
/// `first`, at all sites.
template <int Dim, class T>
std::vector<std::vector<float>> momentum_sizes(const Lattice<Dim>& lattice, const T* first, int fields);

/// Factors for the sparsity weights of the groups (axis, site) of one scale's first-order momenta, from the momenta of
/// the round before (Candes, Wakin and Boyd 2008: what is large is shrunk less, what is small more):
///
///     factor = 1 / (0.15 + 10 s / max s)     s = |m_i| summed over 3^Dim sites, max over all sites and lists
///
/// so a momentum is judged by its neighbourhood along the interface. Takes a list of |m_i| at all sites for each field,
/// and gives as many.
template <int Dim>
std::vector<std::vector<float>> reweighted_factors(const Lattice<Dim>& lattice, std::vector<std::vector<float>> sizes);

/// Factors for elements of which there are none yet, by how strongly the velocity changes at their sites, as a share of
/// its strongest change around them, 0 to 1 (InterfaceNormals):
///
///     factor = 1 / (0.15 + 8 share^4)
///
/// so what the velocity shows takes the place of momenta that a round with even weights would find.
template <class T>
std::vector<float> shear_factors(const std::vector<T>& shares);

/// Factors that set groups free (0) where the momentum is not zero and keep all others at zero (infinity).
std::vector<std::vector<float>> support_factors(std::vector<std::vector<float>> sizes);

}  // namespace saltus
