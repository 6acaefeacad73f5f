#pragma once

#include <unistd.h>

#include <algorithm>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace saltus::server {

/// GOMP_SPINCOUNT of workers whose threads have cores of their own: so many turns a thread stays awake for the next
/// loop before it sleeps; waking it takes longer than many a loop. Where another program wants the same core it only
/// takes its time. Two threads on a liver pair (166x195x25; medians of 2 to 5 runs, seconds of the registration, one
/// thread 1.3 and 3.6), alone and beside a program that keeps one of the two cores busy:
///
///     turns          0     500   1000  2000  5000  20000
///     auto           1.46  1.10  1.05  1.06  1.13  1.06
///       beside one   1.72  1.85  1.9   2.6   3.3   5.3
///     sliding        3.5   2.6   2.7   2.7   2.5   2.5
///       beside one   4.3   4.6   5.3   5.7   7.4   12.5
///
/// Two pairs at once on two cores, of which one waits awake: 6.4 s with none, 6.2, 6.1 and, with 2000 turns, 7.0 s.
inline constexpr const char* kBriefWait = "1000";

/// Lets malloc ask for pages of 2 MiB where the kernel leaves that to programs: a pair takes 5 to 10 % less processor
/// time, most of it in what threads cannot share, the first touch of new memory. Of fields that do not fill them some
/// more of it is taken: 354 for 320 MB where one of 64^3 voxels meets one of 192^3 at full resolution, with masks.
inline constexpr const char* kLargePages = "glibc.malloc.hugetlb=1";

/// What the environment of a worker that the daemon launches holds of threads and memory, by name. `inherited`: what
/// the worker's GLIBC_TUNABLES would be without; what is told there of large pages stays.
/// Threads are not bound: each worker would bind its first one to the same core.
inline std::vector<std::pair<std::string, std::string>> worker_variables(int threads, bool has_cores_alone,
                                                                         const char* inherited = nullptr) {
  std::string tunables = inherited ? inherited : "";
  if (tunables.find("glibc.malloc.hugetlb") == std::string::npos)
    tunables += (tunables.empty() ? "" : ":") + std::string(kLargePages);
  return {{"OMP_NUM_THREADS", std::to_string(threads)},
          {"OMP_WAIT_POLICY", "PASSIVE"},
          {"OMP_PROC_BIND", "false"},
          {"GOMP_SPINCOUNT", has_cores_alone ? kBriefWait : "0"},
          {"GLIBC_TUNABLES", tunables}};
}

/// This process's environment as NAME=VALUE, with `own` in place of what it says of the same names.
inline std::vector<std::string> environment_with(const std::vector<std::pair<std::string, std::string>>& own) {
  std::vector<std::string> variables;
  for (const auto& [name, value] : own) variables.push_back(name + "=" + value);
  for (char** variable = environ; *variable; ++variable) {
    const std::string_view text(*variable), name = text.substr(0, text.find('='));
    if (std::none_of(own.begin(), own.end(), [name](const auto& one) { return one.first == name; }))
      variables.emplace_back(text);
  }
  return variables;
}

}  // namespace saltus::server
