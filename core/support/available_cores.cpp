#include "core/support/available_cores.h"

#include "core/support/control_groups.h"
#include "core/support/thread_binding.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <thread>

#ifdef _OPENMP
#include <omp.h>
#endif

namespace saltus {
namespace fs = std::filesystem;
namespace {

int cores_of_affinity() {
#ifdef _OPENMP
  const int cores = std::max(1, omp_get_num_procs());  // the C++ library counts all of the machine
  const auto bound = static_cast<int>(cores_of_places().size());
  return bound > 0 ? std::min(cores, bound) : cores;
#else
  return std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
#endif
}

/// Cores that a group may use in the mean, infinity where that is not bounded or not told.
double quota_of(const fs::path& group) {
  double quota = 0, period = 0;
  if (std::ifstream second(group / "cpu.max"); second >> quota >> period && quota > 0 && period > 0)
    return quota / period;
  std::ifstream first(group / "cpu.cfs_quota_us"), of(group / "cpu.cfs_period_us");
  if (first >> quota && of >> period && quota > 0 && period > 0) return quota / period;
  return std::numeric_limits<double>::infinity();
}

}  // namespace

int available_cores(const fs::path& root) {
  double quota = std::numeric_limits<double>::infinity();
  for (const fs::path& group : control_groups_around("cpu", root)) quota = std::min(quota, quota_of(group));
  const int cores = cores_of_affinity();
  return quota < cores ? std::max(1, static_cast<int>(std::floor(quota))) : cores;
}

}  // namespace saltus
