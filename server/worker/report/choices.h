#pragma once

#include "server/worker/report/report.h"

#include <string>
#include <vector>

namespace saltus::report {

/// One setting that is not its model's default, or that the registration chose by itself.
struct Choice {
  std::string name, value, unit;
  std::string why;      ///< who chose it, and from what
  bool is_set = false;  ///< by the job, against the default
};

/// Every expert parameter that the job set or the registration filled in, then what was measured in the images: noise,
/// smoothing and weight of each level.
template <int Dim>
std::vector<Choice> choices(const ReportInput<Dim>& input);

/// The command that makes the same result from the same files, for `saltus register`.
template <int Dim>
std::string command_line(const ReportInput<Dim>& input);

}  // namespace saltus::report
