#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace saltus {

/// Sum of term(i) for i in [0, count), in double, in an order that does not depend on the number of threads.
template <class Term>
double ordered_sum(std::size_t count, Term&& term) {
  constexpr std::size_t block = 4096;
  const std::size_t blocks = (count + block - 1) / block;
  std::vector<double> partial(blocks);
#pragma omp parallel for schedule(static)
  for (std::size_t b = 0; b < blocks; ++b) {
    double sum = 0;
    const std::size_t end = std::min(count, (b + 1) * block);
    for (std::size_t i = b * block; i < end; ++i) sum += term(i);
    partial[b] = sum;
  }
  double total = 0;
  for (double sum : partial) total += sum;
  return total;
}

}  // namespace saltus
