#pragma once

#include <cstddef>
#include <vector>

namespace saltus {

/// The figures by which errors are reported; all 0 for no values.
struct Statistics {
  std::size_t n = 0;
  double mean = 0;
  double sd = 0;  ///< of the population (divided by n)
  double median = 0;
  double p90 = 0;  ///< linear between the two order statistics around place 0.9 (n - 1)
  double max = 0;
};

Statistics summarise(std::vector<double> values);

/// Value below which the share `quantile` in [0, 1] of `sorted` lies, linear between neighbours. `sorted` is not empty.
double quantile_of_sorted(const std::vector<double>& sorted, double quantile);

/// The same of values in any order, which it changes, in time proportional to their number.
double quantile_of(std::vector<double>& values, double quantile);

}  // namespace saltus
