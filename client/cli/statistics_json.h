#pragma once

#include "core/evaluation/statistics.h"

#include <nlohmann/json_fwd.hpp>

namespace saltus::cli {

/// {"n", "mean", "sd", "median", "p90", "max"}: the same names wherever a command prints errors.
nlohmann::json as_json(const Statistics& statistics);

}  // namespace saltus::cli
