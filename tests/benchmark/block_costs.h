#pragma once

#include <iosfwd>
#include <vector>

#include "tests/benchmark/table.h"

namespace saltus::benchmark {

/// CPU time of one evaluation of energy and gradient with first-order momenta in some blocks only, beside order 0 alone
/// in the same run: nothing active, a few blocks, those around a sphere, half of them, all; with and without a look at
/// the gradient of the inactive ones. Single precision, one thread.
std::vector<Row> block_cost_rows(bool is_quick, std::ostream& progress);
std::vector<Column> block_cost_columns();

}  // namespace saltus::benchmark
