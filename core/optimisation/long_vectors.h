#pragma once

#include "core/support/reduction.h"
#include "core/support/thread_count.h"

#include <cstddef>
#include <vector>

namespace saltus {

// In threads where that is worth it, with the same bits for any number of them.

/// a . b, in double.
template <class A, class B>
double dot(const std::vector<A>& a, const std::vector<B>& b) {
  return ordered_sum(a.size(), [&](std::size_t i) { return static_cast<double>(a[i]) * static_cast<double>(b[i]); });
}

/// sum += factor terms
template <class Term, class T>
void add_scaled(double factor, std::size_t count, const Term* terms, T* sum) {
  const T f = static_cast<T>(factor);
#pragma omp parallel for simd schedule(static) if (is_worth_threads(count))
  for (std::size_t i = 0; i < count; ++i) sum[i] += f * static_cast<T>(terms[i]);
}

template <class Term, class T>
void add_scaled(double factor, const std::vector<Term>& terms, std::vector<T>& sum) {
  add_scaled(factor, sum.size(), terms.data(), sum.data());
}

}  // namespace saltus
