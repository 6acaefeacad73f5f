#pragma once

#include "client/cli/study/study_runs.h"

namespace saltus::cli {

/// The figures of Bao, Lu, Ying and Sommer, "Sliding at first order", made again, with a table that the paper does not
/// have. Below `request.out`: `scenes` and `runs`, `figures`, `study.html`, `study.md`, `study.json`. What is there
/// already of the runs is not done again. The lung figures are made of the first liver pair and left out, with a note,
/// where there is none. The exit code.
int paper_study(const StudyRequest& request, bool as_json);

}  // namespace saltus::cli
