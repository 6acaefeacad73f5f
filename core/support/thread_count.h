#pragma once

#include <algorithm>
#include <cstddef>

#ifdef _OPENMP
#include <omp.h>
#endif

namespace saltus {

/// Loops run with `threads` threads (0: as many as they would anyway) while this lives; then as before. For the thread
/// that makes it. Nothing where there is no OpenMP.
class ThreadCount {
 public:
  explicit ThreadCount([[maybe_unused]] int threads) {
#ifdef _OPENMP
    before_ = omp_get_max_threads();
    if (threads > 0) omp_set_num_threads(threads);
#endif
  }
  ~ThreadCount() {
#ifdef _OPENMP
    omp_set_num_threads(before_);
#endif
  }
  ThreadCount(const ThreadCount&) = delete;
  ThreadCount& operator=(const ThreadCount&) = delete;

 private:
  [[maybe_unused]] int before_ = 1;
};

/// Sites that are worth a thread. Tests whose lattices are smaller ask for less (tests/support/many_threads.h); nobody
/// else writes to it.
inline std::size_t sites_a_thread = 32768;

/// As many threads as loops over so many sites are worth, of those that there are: a loop over few sites is over before
/// a thread that sleeps is awake. Two threads took 10 times as long as one on 128x128 sites.
inline int threads_worth(std::size_t sites) {
#ifdef _OPENMP
  return std::clamp(static_cast<int>(sites / sites_a_thread), 1, omp_get_max_threads());
#else
  return 1;
#endif
}

/// For `#pragma omp parallel if`: within a level there are lattices and loops that are worth one thread alone.
inline bool is_worth_threads(std::size_t sites) { return threads_worth(sites) > 1; }

}  // namespace saltus
