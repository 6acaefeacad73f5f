#pragma once

#include <string>
#include <utility>
#include <vector>

namespace saltus::server {

/// GOMP_SPINCOUNT of workers whose threads have cores of their own: so many turns a thread stays awake for the next
/// loop before it sleeps; waking it takes longer than many a loop. Two threads on a liver pair (166x195x25, median
/// seconds of the levels, one thread 1.14): 1.13 with 2000 turns and loops of 64K sites and more shared out, 0.98 with
/// loops of 16K sites, 0.71 with these turns, and no less with five times as many. Where other workers wait for the
/// same core it only takes their time: two pairs at once on two cores took 19 s instead of 15 already with 1000 turns.
inline constexpr const char* kBriefWait = "20000";

/// Lets malloc ask for pages of 2 MiB where the kernel leaves that to programs: a pair takes 5 to 10 % less processor
/// time, most of it in what threads cannot share, the first touch of new memory. Fields are used wholly, so no more of
/// it is taken.
inline constexpr const char* kLargePages = "glibc.malloc.hugetlb=1";

/// What the environment of a worker that the daemon launches holds of threads and memory, by name. `inherited`: what
/// the worker's GLIBC_TUNABLES would be without; what is told there of large pages stays.
inline std::vector<std::pair<std::string, std::string>> worker_variables(int threads, bool has_cores_alone,
                                                                         const char* inherited = nullptr) {
  std::string tunables = inherited ? inherited : "";
  if (tunables.find("glibc.malloc.hugetlb") == std::string::npos)
    tunables += (tunables.empty() ? "" : ":") + std::string(kLargePages);
  return {{"OMP_NUM_THREADS", std::to_string(threads)},
          {"OMP_WAIT_POLICY", "PASSIVE"},
          {"GOMP_SPINCOUNT", has_cores_alone ? kBriefWait : "0"},
          {"GLIBC_TUNABLES", tunables}};
}

}  // namespace saltus::server
