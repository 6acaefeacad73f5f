#pragma once

#include "core/support/thread_count.h"

#include <algorithm>
#include <cstddef>
#include <type_traits>
#include <vector>

namespace saltus {

/// Sum of term(i) for i in [0, count), in double, in an order that does not depend on the number of threads: blocks one
/// after the other, each in lanes, so that no addition waits for the one before. Terms that are floats, which are to be
/// good to no more than some 5e-7 of what is added up, are summed eight at a time as such: to convert each takes longer
/// than all else.
template <class Term>
double ordered_sum(std::size_t count, Term&& term) {
  using Value = std::remove_cvref_t<decltype(term(std::size_t{}))>;
  constexpr std::size_t block = 4096, lanes = 16, together = std::is_same_v<Value, float> ? 8 : 1;
  const std::size_t blocks = (count + block - 1) / block;
  std::vector<double> partial(blocks);
#pragma omp parallel for schedule(static) if (is_worth_threads(count))
  for (std::size_t b = 0; b < blocks; ++b) {
    double sums[lanes] = {};
    const std::size_t end = std::min(count, (b + 1) * block);
    std::size_t i = b * block;
    if constexpr (together > 1)
      for (; i + together * lanes <= end; i += together * lanes) {
        Value some[lanes] = {};
        for (std::size_t k = 0; k < together; ++k)
#pragma omp simd
          for (std::size_t lane = 0; lane < lanes; ++lane) some[lane] += term(i + k * lanes + lane);
#pragma omp simd
        for (std::size_t lane = 0; lane < lanes; ++lane) sums[lane] += static_cast<double>(some[lane]);
      }
    for (; i + lanes <= end; i += lanes)
#pragma omp simd  // without it terms that are converted are taken one by one
      for (std::size_t lane = 0; lane < lanes; ++lane) sums[lane] += static_cast<double>(term(i + lane));
    for (std::size_t lane = 0; i < end; ++i, ++lane) sums[lane] += static_cast<double>(term(i));
    double sum = 0;
    for (double one : sums) sum += one;
    partial[b] = sum;
  }
  double total = 0;
  for (double sum : partial) total += sum;
  return total;
}

}  // namespace saltus
