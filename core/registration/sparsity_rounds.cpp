#include "core/registration/sparsity_rounds.h"

#include "core/registration/scales.h"

#include <cmath>

namespace saltus {

std::vector<SparsityRound> sparsity_rounds(const RegistrationOptions::Momenta& momenta, bool has_first_order,
                                           bool has_found) {
  using Weights = SparsityRound::Weights;
  if (!has_first_order || momenta.sparsity == 0) return {{Weights::Even, 1}};
  std::vector<SparsityRound> rounds;
  if (momenta.first_order_waits) rounds.push_back({Weights::Even, 1, false});
  const bool has_shear =
      momenta.shear_weights > 0 && momenta.first_order_waits && has_oriented_alone(momenta) && !has_found;
  const bool has_path = !has_shear && (!has_found || momenta.reweighted_rounds == 0);
  const double last = momenta.reweighted_rounds > 0 ? momenta.even_sparsity : 1;
  for (int k = momenta.sparsity_path - 1; k >= 0 && has_path; --k)
    rounds.push_back({Weights::Even, std::ldexp(last, k)});
  if (has_shear) rounds.push_back({Weights::OfShear, 1});
  for (int k = has_shear && momenta.shear_weights == 2 ? 1 : 0; k < momenta.reweighted_rounds; ++k)
    rounds.push_back({Weights::Reweighted, 1});
  if (momenta.debias) rounds.push_back({Weights::Debiased, 1});
  return rounds;
}

}  // namespace saltus
