#include "core/registration/working_set.h"

#include "core/momenta/reweighting.h"
#include "core/support/errors.h"
#include "core/support/free_memory.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace saltus {

namespace {

using Lists = std::vector<std::vector<float>>;

bool are_zero(const Lists& lists) {
  return std::all_of(lists.begin(), lists.end(), [](const std::vector<float>& list) {
    return std::all_of(list.begin(), list.end(), [](float value) { return value == 0; });
  });
}

/// By how much the m_i of a coarser lattice make those of a finer one cheaper, at most: it knows about where they are,
/// and beside oriented momenta those that are steps should not be favoured.
constexpr float kLeastCarried = 0.6f;

/// Of the nearest sites of another lattice.
template <int Dim>
Lists carried(const Lattice<Dim>& from, const Lists& lists, const Lattice<Dim>& to) {
  Lists result(lists.size(), std::vector<float>(to.sites()));
  for (int slab = 0; slab < to.size[Dim - 1]; ++slab)
    visit_slab<Dim>(to, slab, [&](const Index<Dim>& index, std::size_t site) {
      std::size_t at = 0, stride = 1;
      for (int a = 0; a < Dim; ++a) {
        const double x = (to.offset[a] + index[a] * to.spacing[a] - from.offset[a]) / from.spacing[a];
        at += stride * static_cast<std::size_t>(std::clamp(std::lround(x), 0l, from.size[a] - 1l));
        stride *= static_cast<std::size_t>(from.size[a]);
      }
      for (std::size_t k = 0; k < lists.size(); ++k) result[k][site] = lists[k][at];
    });
  return result;
}

}  // namespace

/// Of the first orders of a scale at all sites: |m_i| by field, then, where it has elements, |m| by normal.
template <int Dim, class T>
std::vector<std::vector<float>> WorkingSet<Dim, T>::sizes_of(std::size_t scale, const std::vector<T>& x) const {
  const FirstOrder& first = first_[scale];
  const Oriented& oriented = oriented_[scale];
  const Lattice<Dim>& lattice = scales_[scale]->lattice();
  Lists sizes = has_no_blocks(first)
                    ? Lists(static_cast<std::size_t>(first.fields), std::vector<float>(lattice.sites()))
                    : momentum_sizes<Dim, T>(lattice, all_sites(scale, x), first.fields);
  if (!has_elements(scale)) return sizes;
  sizes.resize(first.fields + oriented.momenta->options().normals.size(), std::vector<float>(lattice.sites(), 0.0f));
  const T* values = x.data() + sparsity_[oriented.range].begin;
  for (std::size_t e = 0; e < oriented.active.size(); ++e) {
    double square = 0;
    for (int c = 0; c < Dim - 1; ++c) square += std::pow(static_cast<double>(values[(Dim - 1) * e + c]), 2);
    const std::uint32_t element = oriented.active[e];
    sizes[first.fields + oriented.momenta->normal_of(element)][oriented.momenta->site_of(element)] =
        static_cast<float>(std::sqrt(square));
  }
  return sizes;
}

/// Factors by size, see reweighted_factors, in lists as those of sizes_of. A scale that has no first orders yet takes
/// them from the next coarser one that has: of its m_i field by field; of its elements, whose normals may be others,
/// from all that is there, in one list. Where there is none either they are 1 (empty lists).
template <int Dim, class T>
std::vector<std::vector<float>> WorkingSet<Dim, T>::reweighted(std::size_t scale, const std::vector<T>& x) const {
  const Lattice<Dim>& lattice = scales_[scale]->lattice();
  const std::size_t fields = static_cast<std::size_t>(first_[scale].fields);
  Lists sizes = sizes_of(scale, x);
  if (!are_zero(sizes)) return reweighted_factors<Dim>(lattice, std::move(sizes));
  const std::size_t lists = sizes.size();
  sizes = {};  // they are large, and what comes next is as well
  for (std::size_t coarser = scale; coarser-- > 0;) {
    if (static_cast<std::size_t>(first_[coarser].fields) != fields) continue;
    Lists others = sizes_of(coarser, x);
    if (are_zero(others)) continue;
    std::vector<float> all = others[0];
    for (const std::vector<float>& list : others)
      for (std::size_t site = 0; site < all.size(); ++site) all[site] = std::max(all[site], list[site]);
    others.resize(fields);
    if (lists > fields) others.push_back(std::move(all));
    const Lattice<Dim>& from = scales_[coarser]->lattice();
    Lists factors = reweighted_factors<Dim>(from, std::move(others));
    for (std::size_t field = 0; field < fields; ++field)
      for (float& factor : factors[field]) factor = std::max(factor, kLeastCarried);
    factors = carried<Dim>(from, factors, lattice);
    return factors;
  }
  return Lists(lists);
}

template <int Dim, class T>
void WorkingSet<Dim, T>::weigh(const SparsityRound& round, const std::vector<T>& x) {
  lets_blocks_join_ = round.lets_blocks_join;
  for (std::size_t s = 0; s < scales_.size(); ++s) {
    if (!scales_[s]->can_slide()) continue;
    const std::size_t fields = static_cast<std::size_t>(first_[s].fields), sites = scales_[s]->lattice().sites();
    Oriented& oriented = oriented_[s];
    Lists factors;  // of the fields, then of elements: by normal, or one list for all normals
    switch (round.weights) {
      case SparsityRound::Weights::Even:
        factors.assign(fields + has_elements(s),
                       std::vector<float>(round.factor == 1 ? 0 : sites, static_cast<float>(round.factor)));
        break;
      case SparsityRound::Weights::OfShear:
        factors.assign(fields, std::vector<float>());
        if (!has_elements(s)) break;
        if (oriented.strengths.empty()) throw std::logic_error("weights of shear are asked for before a turn");
        factors.push_back(shear_factors(oriented.strengths));
        break;
      case SparsityRound::Weights::Reweighted:
        factors = reweighted(s, x);
        break;
      case SparsityRound::Weights::Debiased:
        factors = support_factors(sizes_of(s, x));
        break;
    }
    free_vector(oriented.strengths);
    if (oriented.momenta) {
      free_vector(factors_[oriented.range]);
      std::size_t count = 0;
      for (std::size_t n = fields; n < factors.size(); ++n) count += factors[n].size();
      std::vector<float> together;
      together.reserve(count);
      for (std::size_t n = fields; n < factors.size(); ++n) {
        together.insert(together.end(), factors[n].begin(), factors[n].end());
        free_vector(factors[n]);  // nine of them have as many values as three vector fields
      }
      factors_[oriented.range] = std::move(together);
    }
    std::move(factors.begin(), factors.begin() + static_cast<std::ptrdiff_t>(fields),
              factors_.begin() + static_cast<std::ptrdiff_t>(first_[s].range));
  }
  gather_factors();
}

template <int Dim, class T>
void WorkingSet<Dim, T>::restore_weights(const SparsityRound& round, const std::vector<std::vector<float>>& factors) {
  bool fits = factors.size() == sparsity_.size();
  for (std::size_t r = 0; fits && r < blocks_.size(); ++r)
    fits = factors[r].empty() || factors[r].size() == blocks_[r].all_sites();
  for (const Oriented& oriented : oriented_)
    if (fits && oriented.momenta)
      fits = factors[oriented.range].empty() || factors[oriented.range].size() == oriented.momenta->elements() ||
             factors[oriented.range].size() == oriented.momenta->lattice().sites();
  if (!fits)
    throw InvalidInput("the sparsity factors are " + std::to_string(factors.size()) + " lists for " +
                       std::to_string(sparsity_.size()) + " fields of first-order momenta, or of other lengths");
  lets_blocks_join_ = round.lets_blocks_join;
  factors_ = factors;
  gather_factors();
}

#define SALTUS_WEIGHTS(DIM, T)                                                          \
  template void WorkingSet<DIM, T>::weigh(const SparsityRound&, const std::vector<T>&); \
  template void WorkingSet<DIM, T>::restore_weights(const SparsityRound&, const std::vector<std::vector<float>>&);
SALTUS_WEIGHTS(2, float)
SALTUS_WEIGHTS(3, float)
SALTUS_WEIGHTS(2, double)
SALTUS_WEIGHTS(3, double)
#undef SALTUS_WEIGHTS

}  // namespace saltus
