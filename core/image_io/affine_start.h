#pragma once

#include "core/grid/volume.h"

namespace saltus {

enum class AffineKind { None, Rigid, Affine };

/// Where the images count. Masks are on their image's grid or any other; what is 0 or outside does not count.
template <int Dim>
struct AffineMasks {
  const Volume<Dim>* fixed = nullptr;
  const Volume<Dim>* moving = nullptr;
};

/// Finds the rigid or affine map, fixed world -> moving world, that maximises the Mattes mutual information (32 bins)
/// of `fixed` and the mapped `moving`, so their contrasts may differ. `None` gives the identity.
///
/// It starts from the best of: no motion, centre on centre, centre of mass on centre of mass; then regular steps down
/// the gradient on three levels, of about 4, 2 and 1 times the spacing at which the fixed image has 64^Dim voxels (or
/// its own, if coarser), at most 50,000 samples each. The result is never worse than the start by the same measure, and
/// does not depend on `threads` (0: as many as ITK likes), which smooth and sample; the sum over samples runs in one.
///
/// Calls wait for each other, because the thread count is a global of ITK. Throws InvalidInput for a constant image, a
/// mask that covers nothing, or an image thinner than 4 voxels along an axis; NumericalFailure when ITK finds no map.
template <int Dim>
AffineMap<Dim> find_affine_start(const Volume<Dim>& fixed, const Volume<Dim>& moving, AffineKind kind, int threads = 0,
                                 const AffineMasks<Dim>& masks = {});

}  // namespace saltus
