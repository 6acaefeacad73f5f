#pragma once

#include "core/registration/options.h"

namespace saltus {

/// Fills in what order 0 has to show for first orders to take part, and what it weighs beside them: first_order_shear,
/// plain_shear, settled_plain_shear, finer_shear (simple_shear.h), quick_share and quick_tolerance where they are -1,
/// regularisation_beside_first and regularisation_beside_plain where they are 0. As measured: core/measurements.md,
/// "Only where it slides", "Where order 0 begins beside first orders" and "Regularisation". All else must be resolved.
/// Where order 0 is not asked at all (first_order_shear 0), what depends on that is 0, narrower_pull too.
void resolve_slip_criteria(int dimension, RegistrationOptions& options);

}  // namespace saltus
