#pragma once

#include "server/worker/report/analysis.h"

#include <string>
#include <vector>

namespace saltus::report {

/// Good: as it should be. Look: somebody should look before the result is used. Bad: most likely not usable as it is.
enum class Verdict { Good, Look, Bad };
std::string to_string(Verdict verdict);  ///< "good", "look" or "bad"

struct Finding {
  Verdict verdict = Verdict::Good;
  std::string text;  ///< one or two sentences with the numbers they stand on
};

/// What a reader should know first, in a fixed order: the registration's own notices, landmarks, similarity, folds,
/// what slides and opens, motion beyond the moving image, how the levels ended, the inverse.
template <int Dim>
std::vector<Finding> findings(const ReportInput<Dim>& input, const Analysis<Dim>& analysis);

}  // namespace saltus::report
