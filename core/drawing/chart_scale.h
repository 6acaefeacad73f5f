#pragma once

#include <limits>
#include <string>
#include <vector>

namespace saltus::drawing {

/// The values that an axis shows.
struct Range {
  double low = std::numeric_limits<double>::infinity();
  double high = -std::numeric_limits<double>::infinity();
  void add(double value);
};

/// A range of no width gets some around its value, an empty one becomes 0 to 1.
void widen_if_empty(Range& range);

/// 1, 2 or 5 times a power of ten, so that about four steps fill the range.
double tick_step(const Range& range);

/// The multiples of `step` in the range, ascending.
std::vector<double> ticks(const Range& range, double step);

/// Power of ten, a multiple of 3, that is taken out of large and small values so that ticks stay short.
double scale_of(const Range& range);

/// A tick with the digits that tell it from its neighbours, `step` away.
std::string tick_text(double value, double step);

}  // namespace saltus::drawing
