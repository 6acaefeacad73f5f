#pragma once

#include "core/grid/lattice.h"

namespace saltus {

/// Factors for the sparsity weights of the groups (axis, site) of one scale's first-order momenta, from the momenta of
/// the round before (Candes, Wakin and Boyd 2008: what is large is shrunk less, what is small more):
///
///     factor = 1 / (0.15 + 10 s / max s)     s = |m_i| summed over 3^Dim sites, max over all sites and axes
///
/// so a momentum is judged by its neighbourhood along the interface. `first` holds `fields` fields (Dim, or one where
/// momenta have a direction of their own) one after the other; returns as many vectors, one factor a site.
template <int Dim, class T>
std::vector<std::vector<float>> reweighted_factors(const Lattice<Dim>& lattice, const T* first, int fields = Dim);

/// The same from |m_i| at all sites, one list for each field.
template <int Dim>
std::vector<std::vector<float>> reweighted_factors(const Lattice<Dim>& lattice, std::vector<std::vector<float>> sizes);

/// |m_i| of `fields` fields at all sites.
template <int Dim, class T>
std::vector<std::vector<float>> momentum_sizes(const Lattice<Dim>& lattice, const T* first, int fields);

/// Factors that set groups free (0) where the momentum is not zero and keep all others at zero (infinity).
template <int Dim, class T>
std::vector<std::vector<float>> support_factors(const Lattice<Dim>& lattice, const T* first, int fields = Dim);
/// The same from |m_i|.
std::vector<std::vector<float>> support_factors(std::vector<std::vector<float>> sizes);

}  // namespace saltus
