#pragma once

#include "core/registration/options.h"
#include "tests/benchmark/measure.h"

namespace saltus::benchmark {

/// The same optimisation on one level, at the pair's own resolution, in single and in double precision: the energy and
/// its gradient at one point, and the displacements where both end after the same number of iterations. Intensities
/// are divided by 255. The options must be resolved to scales; their pyramid is not used.
template <int Dim>
Row compare_precision(const std::string& name, const Pair<Dim>& pair, const RegistrationOptions& options);

}  // namespace saltus::benchmark
