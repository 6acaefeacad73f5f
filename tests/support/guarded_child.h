#pragma once

#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fcntl.h>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <exception>
#include <fstream>
#include <functional>
#include <new>
#include <stdexcept>
#include <string>

namespace saltus::testing_support {

/// What became of cases that were tried in a process of their own.
struct GuardedResult {
  std::size_t done = 0;            ///< cases that came to an end
  std::size_t counts[2] = {0, 0};  ///< how many of them returned false and true
  std::string problem;             ///< "" or what happened in case number `done`
};

struct Guard {
  unsigned cpu_seconds = 10;                   ///< of processor time for one case: more is a hang
  std::size_t memory = std::size_t{64} << 20;  ///< more than the process has when it begins
};

namespace detail {

struct SharedPage {
  std::size_t done = 0;
  std::size_t counts[2] = {0, 0};
  char problem[1024] = "";
};

inline std::size_t data_of_this_process() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);)
    if (line.starts_with("VmData:")) return std::stoull(line.substr(7)) * 1024;
  throw std::runtime_error("/proc/self/status has no VmData");
}

inline void limit(int what, rlim_t value) {
  rlimit limits{};
  getrlimit(static_cast<__rlimit_resource>(what), &limits);
  limits.rlim_cur = value;
  if (setrlimit(static_cast<__rlimit_resource>(what), &limits) != 0) throw std::runtime_error("setrlimit failed");
}

[[noreturn]] inline void run_cases(SharedPage& page, std::size_t count, const Guard& guard,
                                   const std::function<bool(std::size_t)>& one) {
  try {
    // The libraries under test may say what they like.
    const int nowhere = open("/dev/null", O_WRONLY | O_CLOEXEC);
    dup2(nowhere, 1);
    dup2(nowhere, 2);
    limit(RLIMIT_CORE, 0);
    limit(RLIMIT_DATA, data_of_this_process() + guard.memory);
    for (; page.done < count; ++page.done) {
      rusage used{};
      getrusage(RUSAGE_SELF, &used);
      limit(RLIMIT_CPU, static_cast<rlim_t>(used.ru_utime.tv_sec + used.ru_stime.tv_sec) + guard.cpu_seconds + 2);
      ++page.counts[one(page.done) ? 1 : 0];
    }
    _exit(0);
  } catch (const std::bad_alloc&) {
    std::strcpy(page.problem, "it wants more memory than it may have");
  } catch (const std::exception& error) {
    std::snprintf(page.problem, sizeof page.problem, "it throws: %s", error.what());
  }
  _exit(1);
}

}  // namespace detail

/// Calls `one` with 0 to count-1 in a child process, which may hang, crash or want too much memory without harm. Ends
/// with the first case that does, or that throws. Processor time is measured, no clock.
inline GuardedResult run_guarded(std::size_t count, const std::function<bool(std::size_t)>& one,
                                 const Guard& guard = {}) {
  void* memory = mmap(nullptr, sizeof(detail::SharedPage), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  if (memory == MAP_FAILED) throw std::runtime_error("no shared memory");
  auto* page = new (memory) detail::SharedPage;
  const pid_t child = fork();
  if (child < 0) throw std::runtime_error("fork failed");
  if (child == 0) detail::run_cases(*page, count, guard, one);
  int status = 0;
  waitpid(child, &status, 0);
  GuardedResult result{page->done, {page->counts[0], page->counts[1]}, page->problem};
  munmap(memory, sizeof(detail::SharedPage));
  if (WIFSIGNALED(status))
    result.problem =
        WTERMSIG(status) == SIGXCPU ? "it hangs" : std::string("it crashes: ") + strsignal(WTERMSIG(status));
  else if (WEXITSTATUS(status) != 0 && result.problem.empty())
    result.problem = "it ends the process with code " + std::to_string(WEXITSTATUS(status));
  return result;
}

}  // namespace saltus::testing_support
