#include "core/support/thread_binding.h"

#include <sched.h>

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <system_error>
#include <vector>

#ifdef _OPENMP
#include <omp.h>
#endif

namespace saltus {

void release_thread() {
#ifdef _OPENMP
  std::vector<int> cores;
  for (int place = 0; place < omp_get_num_places(); ++place) {
    std::vector<int> own(static_cast<std::size_t>(omp_get_place_num_procs(place)));
    omp_get_place_proc_ids(place, own.data());
    cores.insert(cores.end(), own.begin(), own.end());
  }
  if (cores.empty()) return;
  const int count = *std::max_element(cores.begin(), cores.end()) + 1;
  cpu_set_t* const set = CPU_ALLOC(count);
  const std::size_t bytes = CPU_ALLOC_SIZE(count);
  CPU_ZERO_S(bytes, set);
  for (int core : cores) CPU_SET_S(core, bytes, set);
  const int error = sched_setaffinity(0, bytes, set) == 0 ? 0 : errno;
  CPU_FREE(set);
  if (error != 0) throw std::system_error(error, std::generic_category(), "cores of OMP_PLACES");
#endif
}

}  // namespace saltus
