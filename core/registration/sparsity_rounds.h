#pragma once

#include "core/registration/options.h"

#include <vector>

namespace saltus {

/// One minimisation of a level: how the sparsity weights of the first-order groups are made for it. Each round starts
/// from where the one before ended.
struct SparsityRound {
  enum class Weights {
    Even,        ///< lambda times `factor` for every group
    OfShear,     ///< for elements lambda times a factor from how strongly order 0's velocity changes, by shear or not;
                 ///< even for others
    Reweighted,  ///< lambda times a factor from the momenta of the round before, see momenta/reweighting.h; where a
                 ///< scale has none yet, from those of a coarser one
    Debiased     ///< 0 on the support of the round before, infinite elsewhere: the shrinkage of the norm is taken back
  };
  Weights weights = Weights::Even;
  double factor = 1;
  bool lets_blocks_join = true;  ///< whether first-order momenta may appear where there are none
};

/// The rounds of a level: where first orders wait, one in which none appear; the path of weights lambda 2^(n-1), ..., 2
/// lambda, lambda (`even_sparsity` times as much where reweighted rounds follow), then these, then the debiasing round.
/// Where a coarser level `has_found` first orders, reweighted rounds know already where, and there is no path. Where
/// none has and oriented momenta are alone and wait, one round whose weights follow order 0's velocity takes the place
/// of the path (`shear_weights` 1) and of the first reweighted one as well (2). Without first-order momenta one round.
std::vector<SparsityRound> sparsity_rounds(const RegistrationOptions::Momenta& momenta, bool has_first_order,
                                           bool has_found);

}  // namespace saltus
