#pragma once

#include "core/support/thread_count.h"

#include <omp.h>

namespace saltus::testing {

/// While this lives, every loop has as many threads as are asked for, however small its lattice is; then as before.
class ManyThreads {
 public:
  ManyThreads() { sites_a_thread = {1, 1}; }
  ~ManyThreads() {
    sites_a_thread = sites_;
    omp_set_num_threads(threads_);
  }
  ManyThreads(const ManyThreads&) = delete;
  ManyThreads& operator=(const ManyThreads&) = delete;

 private:
  const SitesAThread sites_ = sites_a_thread;
  const int threads_ = omp_get_max_threads();
};

}  // namespace saltus::testing
