#include "server/worker/process_limits.h"

#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <csignal>
#include <cstring>
#include <fstream>
#include <iostream>
#include <string>

namespace saltus::worker {
namespace {

constexpr rlim_t most_open_files = 1024;
constexpr std::int64_t reserve_bytes = 256ll << 20;
constexpr rlim_t cpu_reserve_seconds = 60;
constexpr std::int64_t stack_bytes = 8ll << 20;
constexpr int network_threads = 8;

std::atomic<bool> is_cpu_time_used_up = false;
std::atomic<bool> is_memory_used_up = false;
std::atomic<int> out_of_memory_code = 0;
static_assert(std::atomic<bool>::is_always_lock_free && std::atomic<int>::is_always_lock_free,
              "used by signal handlers");

/// What malloc asks the kernel for when everything smaller was refused.
constexpr std::size_t smallest_request = 1 << 20;

/// A system call and nothing else, so that it may be used in a signal handler.
bool has_memory_left() {
  void* const memory = mmap(nullptr, smallest_request, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (memory == MAP_FAILED) return false;
  munmap(memory, smallest_request);
  return true;
}

void on_abort(int) {
  if (!is_memory_used_up && has_memory_left()) return;
  constexpr char message[] = "saltus-worker: aborted for want of memory\n";
  [[maybe_unused]] const ssize_t written = write(STDERR_FILENO, message, sizeof message - 1);
  _exit(out_of_memory_code);
}

/// Lowers a limit; what is lower already stays.
void lower(__rlimit_resource resource, const char* name, rlim_t soft, rlim_t hard) {
  rlimit limit{};
  getrlimit(resource, &limit);
  limit.rlim_max = std::min(limit.rlim_max, hard);
  limit.rlim_cur = std::min({limit.rlim_cur, soft, limit.rlim_max});
  if (setrlimit(resource, &limit) != 0)
    std::cerr << "saltus-worker: the limit " << name << " cannot be set: " << std::strerror(errno) << std::endl;
}

/// The field of /proc/self/statm, in bytes: 1 is resident memory, 5 is data and stacks.
std::int64_t statm_bytes(int field) {
  std::ifstream file("/proc/self/statm");
  std::int64_t pages = 0;
  for (int i = 0; i <= field; ++i) file >> pages;
  return pages * sysconf(_SC_PAGESIZE);
}

}  // namespace

ProcessUse process_use() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& time) {
    return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
  };
  return {statm_bytes(1), seconds(usage.ru_utime) + seconds(usage.ru_stime)};
}

void prepare_process() {
  lower(RLIMIT_CORE, "RLIMIT_CORE", 0, 0);
  lower(RLIMIT_NOFILE, "RLIMIT_NOFILE", most_open_files, most_open_files);
  // Raising one's own score needs no rights; a system without /proc has no such killer.
  std::ofstream("/proc/self/oom_score_adj") << 500;
  struct sigaction action {};
  action.sa_handler = [](int) { is_cpu_time_used_up = true; };
  action.sa_flags = SA_RESTART;
  sigaction(SIGXCPU, &action, nullptr);
  // A file that may not grow further is then a write that fails, which has its own exit code and clears up.
  std::signal(SIGXFSZ, SIG_IGN);
}

void limit_process(std::int64_t memory_bytes, double cpu_seconds, int threads) {
  if (memory_bytes > 0) {
    const auto soft = static_cast<rlim_t>(statm_bytes(5) + (threads + network_threads) * stack_bytes + memory_bytes);
    lower(RLIMIT_DATA, "RLIMIT_DATA", soft, soft + reserve_bytes);
  }
  if (cpu_seconds > 0) {
    const auto soft = static_cast<rlim_t>(std::ceil(std::min(cpu_seconds, 1e9)));
    lower(RLIMIT_CPU, "RLIMIT_CPU", soft, soft + cpu_reserve_seconds);
  }
}

void release_reserve() {
  rlimit limit{};
  getrlimit(RLIMIT_DATA, &limit);
  limit.rlim_cur = limit.rlim_max;
  setrlimit(RLIMIT_DATA, &limit);
}

void note_memory_is_used_up() {
  is_memory_used_up = true;
  release_reserve();
}

bool memory_is_used_up() { return is_memory_used_up; }

void exit_when_out_of_memory(int exit_code) {
  out_of_memory_code = exit_code;
  struct sigaction action {};
  action.sa_handler = on_abort;
  sigaction(SIGABRT, &action, nullptr);
}

bool cpu_time_is_used_up() { return is_cpu_time_used_up; }

}  // namespace saltus::worker
