#pragma once

namespace saltus::benchmark {

/// What this machine can do with the threads that OpenMP has now, the best of some repetitions.
struct MachineLimits {
  double gigabytes_per_second = 0;  ///< a_i = b_i + s c_i over arrays that no cache holds: two read, one written
  double gigaflops = 0;             ///< multiply and add of floats in registers, two operations each
};

MachineLimits measure_limits();

}  // namespace saltus::benchmark
