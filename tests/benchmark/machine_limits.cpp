#include "tests/benchmark/machine_limits.h"

#include <omp.h>

#include <algorithm>

#include "core/support/registers.h"
#include "core/support/stopwatch.h"

namespace saltus::benchmark {
namespace {

using Lanes = Register<float>;

/// Enough sums that one need not wait for another: the latency of a multiply-add times two a cycle.
constexpr int kSums = 10;

Lanes multiply_and_add(int rounds) {
  Lanes sums[kSums], factor, term;
  for (std::size_t lane = 0; lane < kRegisterLanes<float>; ++lane) factor[lane] = 0.999f, term[lane] = 1e-3f;
  for (int k = 0; k < kSums; ++k) sums[k] = term * static_cast<float>(k);
  for (int round = 0; round < rounds; ++round)
#pragma GCC unroll 10
    for (int k = 0; k < kSums; ++k) sums[k] = sums[k] * factor + term;
  Lanes total = sums[0];
  for (int k = 1; k < kSums; ++k) total += sums[k];
  return total;
}

}  // namespace

void MachineLimits::raise(const MachineLimits& other) {
  gigabytes_per_second = std::max(gigabytes_per_second, other.gigabytes_per_second);
  gigaflops = std::max(gigaflops, other.gigaflops);
}

LimitMeter::LimitMeter() {
  constexpr std::size_t count = std::size_t(24) << 20;
  a_.assign(count, 0);
  b_.assign(count, 1);
  c_.resize(count);
  for (std::size_t i = 0; i < count; ++i) c_[i] = static_cast<float>(i % 7);
}

MachineLimits LimitMeter::measure() {
  MachineLimits limits;
  const auto taken = [](const Stopwatch& watch) {
    return omp_get_max_threads() == 1 ? watch.cpu_seconds() : watch.seconds();
  };
  {
    const float s = 0.5f + 0.01f * static_cast<float>(++measured_ % 12);
    float* a = a_.data();
    const float *b = b_.data(), *c = c_.data();
    const std::size_t count = a_.size();
    const Stopwatch watch;
#pragma omp parallel for simd schedule(static)
    for (std::size_t i = 0; i < count; ++i) a[i] = b[i] + s * c[i];
    limits.gigabytes_per_second = 12e-9 * static_cast<double>(count) / taken(watch);
  }
  constexpr int rounds = 4'000'000;
  float kept = 0;
  int threads = 0;
  const Stopwatch watch;
#pragma omp parallel reduction(+ : kept, threads)
  {
    kept += multiply_and_add(rounds)[0];
    ++threads;
  }
  const double work = 2e-9 * kRegisterLanes<float> * kSums * static_cast<double>(rounds) * threads;
  limits.gigaflops = work / taken(watch);
  // Of use, so that the loop is not left out.
  if (kept == 1.2345f) limits.gigaflops = 0;
  return limits;
}

}  // namespace saltus::benchmark
