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

/// Sites that are worth a thread: of the images of a level, and of a loop within one. Where threads have cores of their
/// own, those of a level stay awake from one loop to the next (server/launch/worker_environment.h). Tests whose
/// lattices are smaller ask for less (tests/support/many_threads.h); nobody else writes to these.
struct SitesAThread {
  std::size_t level = 16384, loop = 8192;
};
inline SitesAThread sites_a_thread;

/// For all of a level, as many as its sites keep busy, of those that there are: one with few sites is over before
/// threads that sleep are awake.
inline int threads_of_level([[maybe_unused]] std::size_t sites) {
#ifdef _OPENMP
  return std::clamp(static_cast<int>(sites / sites_a_thread.level), 1, omp_get_max_threads());
#else
  return 1;
#endif
}

/// All of them where each has sites enough, or one: a pool of threads that is asked for some of them ends the others.
inline int threads_of_loop([[maybe_unused]] std::size_t sites) {
#ifdef _OPENMP
  const int all = omp_get_max_threads();
  return sites / static_cast<std::size_t>(all) >= sites_a_thread.loop ? all : 1;
#else
  return 1;
#endif
}

/// For `#pragma omp parallel if`: within a level there are lattices and loops that are worth one thread alone.
inline bool is_worth_threads(std::size_t sites) { return threads_of_loop(sites) > 1; }

}  // namespace saltus
