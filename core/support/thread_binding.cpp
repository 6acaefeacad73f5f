#include "core/support/thread_binding.h"

#include <sched.h>

#include <algorithm>
#include <cstddef>

#ifdef _OPENMP
#include <omp.h>
#endif

namespace saltus {

std::vector<int> cores_of_places() {
  std::vector<int> cores;
#ifdef _OPENMP
  for (int place = 0; place < omp_get_num_places(); ++place) {
    std::vector<int> own(static_cast<std::size_t>(omp_get_place_num_procs(place)));
    omp_get_place_proc_ids(place, own.data());
    cores.insert(cores.end(), own.begin(), own.end());
  }
#endif
  std::sort(cores.begin(), cores.end());
  cores.erase(std::unique(cores.begin(), cores.end()), cores.end());
  return cores;
}

void release_thread() {
  const std::vector<int> cores = cores_of_places();
  if (cores.empty()) return;
  cpu_set_t* const set = CPU_ALLOC(cores.back() + 1);
  const std::size_t bytes = CPU_ALLOC_SIZE(cores.back() + 1);
  CPU_ZERO_S(bytes, set);
  for (int core : cores) CPU_SET_S(core, bytes, set);
  // Places may name cores that are not this process's: those that it has stay then.
  sched_setaffinity(0, bytes, set);
  CPU_FREE(set);
}

}  // namespace saltus
