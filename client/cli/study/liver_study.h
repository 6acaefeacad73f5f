#pragma once

#include "client/cli/study/study_runs.h"

namespace saltus::cli {

/// Models and presets on the four liver pairs below `request.data`: landmark errors in the liver and outside, folds and
/// CPU seconds, and the figures of each pair. Files as paper_study's. Throws InvalidInput when there are no liver
/// images. The exit code.
int liver_study(const StudyRequest& request, bool as_json);

}  // namespace saltus::cli
