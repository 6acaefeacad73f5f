#pragma once

#include <string>
#include <vector>

#include "tests/benchmark/table.h"

namespace saltus::benchmark {

/// Points that meet surfaces where the velocity jumps, against closed forms: one that crosses several, one that slides
/// along, one that grazes, one that starts where both sides leave. Only those whose name contains `only`.
std::vector<Row> trajectory_rows(const std::string& only);

}  // namespace saltus::benchmark
