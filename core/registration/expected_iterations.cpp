#include "core/registration/expected_iterations.h"

#include <algorithm>
#include <cmath>

namespace saltus {

double expected_iterations_left(const std::vector<double>& energies, const MinimiseOptions& how) {
  const auto done = energies.empty() ? 0 : static_cast<int>(energies.size()) - 1;
  const double until_limit = std::max(0, how.max_iterations - done);
  if (done < 5) return std::min<double>(until_limit, usual_iterations - done);
  const double recent = energies[energies.size() - 6] - energies.back();
  const double least = how.tolerance * (how.decrease_before + energies.front() - energies.back());
  if (recent <= 0) return 0;
  if (least <= 0) return until_limit;
  return std::clamp(done * (std::sqrt(recent / least) - 1), 0.0, until_limit);
}

}  // namespace saltus
