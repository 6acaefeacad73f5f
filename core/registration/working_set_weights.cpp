#include "core/registration/working_set.h"

#include "core/momenta/reweighting.h"
#include "core/support/errors.h"

#include <cmath>

namespace saltus {

template <int Dim, class T>
void WorkingSet<Dim, T>::weigh(const SparsityRound& round, const std::vector<T>& x) {
  lets_blocks_join_ = round.lets_blocks_join;
  for (std::size_t s = 0; s < scales_.size(); ++s) {
    if (first_[s].fields == 0) continue;
    const Lattice<Dim>& lattice = scales_[s]->lattice();
    const int fields = first_[s].fields;
    std::vector<std::vector<float>> factors;
    if (oriented_[s].momenta) {
      factors_[oriented_[s].range].clear();
      if (!oriented_[s].momenta->turned().empty() || !oriented_[s].active.empty()) {
        weigh_with_oriented(round, s, x);
        continue;
      }
    }
    switch (round.weights) {
      case SparsityRound::Weights::Even:
        factors.assign(fields, std::vector<float>(round.factor == 1 ? 0 : lattice.sites(), round.factor));
        break;
      case SparsityRound::Weights::Reweighted:
        factors = reweighted_factors<Dim, T>(lattice, all_sites(s, x), fields);
        break;
      case SparsityRound::Weights::Debiased:
        factors = support_factors<Dim, T>(lattice, all_sites(s, x), fields);
        break;
    }
    std::move(factors.begin(), factors.end(), factors_.begin() + static_cast<std::ptrdiff_t>(first_[s].range));
  }
  gather_factors();
}

/// The same for a scale with oriented momenta: all its first orders, oriented or not, are judged together.
template <int Dim, class T>
void WorkingSet<Dim, T>::weigh_with_oriented(const SparsityRound& round, std::size_t scale, const std::vector<T>& x) {
  const FirstOrder& first = first_[scale];
  const Oriented& oriented = oriented_[scale];
  const Lattice<Dim>& lattice = scales_[scale]->lattice();
  const std::size_t normals = oriented.momenta->options().normals.size(), sites = lattice.sites();
  std::vector<std::vector<float>> sizes = momentum_sizes<Dim, T>(lattice, all_sites(scale, x), first.fields);
  sizes.resize(first.fields + normals, std::vector<float>(sites, 0.0f));
  const T* values = x.data() + sparsity_[oriented.range].begin;
  for (std::size_t e = 0; e < oriented.active.size(); ++e) {
    double square = 0;
    for (int c = 0; c < Dim - 1; ++c) square += std::pow(static_cast<double>(values[(Dim - 1) * e + c]), 2);
    const std::uint32_t element = oriented.active[e];
    sizes[first.fields + oriented.momenta->normal_of(element)][oriented.momenta->site_of(element)] =
        static_cast<float>(std::sqrt(square));
  }
  std::vector<std::vector<float>> factors;
  switch (round.weights) {
    case SparsityRound::Weights::Even:
      factors.assign(sizes.size(), std::vector<float>(round.factor == 1 ? 0 : sites, static_cast<float>(round.factor)));
      break;
    case SparsityRound::Weights::Reweighted:
      factors = reweighted_factors<Dim>(lattice, std::move(sizes));
      break;
    case SparsityRound::Weights::Debiased:
      factors = support_factors(std::move(sizes));
      break;
  }
  std::vector<float>& together = factors_[oriented.range];
  together.clear();
  for (std::size_t n = 0; n < normals; ++n)
    together.insert(together.end(), factors[first.fields + n].begin(), factors[first.fields + n].end());
  std::move(factors.begin(), factors.begin() + first.fields,
            factors_.begin() + static_cast<std::ptrdiff_t>(first.range));
}

template <int Dim, class T>
void WorkingSet<Dim, T>::restore_weights(const SparsityRound& round, const std::vector<std::vector<float>>& factors) {
  bool fits = factors.size() == sparsity_.size();
  for (std::size_t r = 0; fits && r < blocks_.size(); ++r)
    fits = factors[r].empty() || factors[r].size() == blocks_[r].all_sites();
  for (const Oriented& oriented : oriented_)
    if (fits && oriented.momenta)
      fits = factors[oriented.range].empty() || factors[oriented.range].size() == oriented.momenta->elements();
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
