#pragma once

#include <iosfwd>
#include <vector>

#include "tests/benchmark/table.h"

namespace saltus::benchmark {

/// The hot loops beside what the machine can do, measured in the same run, with one thread and with two: time, memory
/// that has to be moved, operations that have to be done, and which share of the time the greater of both would take
/// alone. "By processor time" is how much faster two threads would be if none of them ever waited for a core that
/// others have: on a busy machine the figure beside it says more about the others. Counts are of the task, not of how
/// it is done: every field is read or written once.
std::vector<Row> kernel_rows(bool is_quick, std::ostream& progress);
std::vector<Column> kernel_columns();

}  // namespace saltus::benchmark
