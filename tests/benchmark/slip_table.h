#pragma once

#include <iosfwd>

#include "tests/benchmark/table.h"

namespace saltus::benchmark {

/// The default phantom `slip` with lines at 0, 15, 30 and 45 degrees and a circle of radius 36, registered with every
/// model by ssd with its defaults in one thread. `log` gets a line for each run.
std::vector<Row> slip_rows(bool is_quick, std::ostream& log);

const std::vector<Column>& slip_columns();

}  // namespace saltus::benchmark
