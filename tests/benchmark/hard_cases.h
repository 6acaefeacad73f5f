#pragma once

#include <iosfwd>
#include <string>

#include "tests/benchmark/table.h"

namespace saltus::benchmark {

/// The cases that a registration must survive and be judged on: large motion, slips of every size and angle, interfaces
/// close together or ending, few time steps, extreme kernel widths and spacings, thin, tiny and constant images,
/// extreme intensities, noise, inverted contrast, precision, and threads. `is_quick` leaves out the large images and
/// makes the others small; `only` keeps the cases whose name contains it. `log` gets a line for each case.
std::vector<Row> hard_case_rows(bool is_quick, const std::string& only, std::ostream& log);

const std::vector<Column>& hard_case_columns();

}  // namespace saltus::benchmark
