#pragma once

#include "core/support/thread_count.h"

#include <algorithm>
#include <cstddef>
#include <vector>

namespace saltus {

/// Sum of term(i) for i in [0, count), in double, in an order that does not depend on the number of threads: blocks one
/// after the other, each in lanes, so that no addition waits for the one before.
template <class Term>
double ordered_sum(std::size_t count, Term&& term) {
  constexpr std::size_t block = 4096, lanes = 16;
  const std::size_t blocks = (count + block - 1) / block;
  std::vector<double> partial(blocks);
#pragma omp parallel for schedule(static) if (is_worth_threads(count))
  for (std::size_t b = 0; b < blocks; ++b) {
    double sums[lanes] = {};
    const std::size_t end = std::min(count, (b + 1) * block);
    std::size_t i = b * block;
    for (; i + lanes <= end; i += lanes)
#pragma omp simd  // without it terms that are converted are taken one by one
      for (std::size_t lane = 0; lane < lanes; ++lane) sums[lane] += term(i + lane);
    for (std::size_t lane = 0; i < end; ++i, ++lane) sums[lane] += term(i);
    double sum = 0;
    for (double one : sums) sum += one;
    partial[b] = sum;
  }
  double total = 0;
  for (double sum : partial) total += sum;
  return total;
}

}  // namespace saltus
