#pragma once

#include <vector>

namespace saltus::benchmark {

/// What this machine can do with the threads that OpenMP has now.
struct MachineLimits {
  double gigabytes_per_second = 0;  ///< a_i = b_i + s c_i over arrays that no cache holds: two read, one written
  double gigaflops = 0;             ///< multiply and add of floats in registers, two operations each

  /// The better of both.
  void raise(const MachineLimits& other);
};

/// Measures again and again, between runs of what is compared with the limits: a machine with neighbours is not as fast
/// in one minute as in the next.
class LimitMeter {
 public:
  LimitMeter();
  /// Once, some 30 ms.
  MachineLimits measure();

 private:
  std::vector<float> a_, b_, c_;
  int measured_ = 0;
};

}  // namespace saltus::benchmark
