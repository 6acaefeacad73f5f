#include "core/evaluation/statistics.h"

#include <algorithm>
#include <cmath>

namespace saltus {

double quantile_of_sorted(const std::vector<double>& sorted, double quantile) {
  const double place = quantile * static_cast<double>(sorted.size() - 1);
  const auto low = static_cast<std::size_t>(place);
  const std::size_t high = std::min(low + 1, sorted.size() - 1);
  return sorted[low] + (place - static_cast<double>(low)) * (sorted[high] - sorted[low]);
}

double quantile_of(std::vector<double>& values, double quantile) {
  const double place = quantile * static_cast<double>(values.size() - 1);
  const auto low = values.begin() + static_cast<std::ptrdiff_t>(place);
  std::nth_element(values.begin(), low, values.end());
  const double next = low + 1 == values.end() ? *low : *std::min_element(low + 1, values.end());
  return *low + (place - std::floor(place)) * (next - *low);
}

Statistics summarise(std::vector<double> values) {
  Statistics statistics;
  statistics.n = values.size();
  if (values.empty()) return statistics;
  std::sort(values.begin(), values.end());
  const auto n = static_cast<double>(values.size());
  for (double value : values) statistics.mean += value / n;
  double squares = 0;
  for (double value : values) squares += (value - statistics.mean) * (value - statistics.mean);
  statistics.sd = std::sqrt(squares / n);
  statistics.median = quantile_of_sorted(values, 0.5);
  statistics.p90 = quantile_of_sorted(values, 0.9);
  statistics.max = values.back();
  return statistics;
}

}  // namespace saltus
