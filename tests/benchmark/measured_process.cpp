#include "tests/benchmark/measured_process.h"

#include <fcntl.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <sstream>
#include <stdexcept>

namespace saltus::benchmark {
namespace {

double seconds(const timeval& time) {
  return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
}

/// In the child; returns the error of what has failed.
int become(const std::vector<char*>& words, const std::vector<std::pair<std::string, std::string>>& environment,
           const char* log) {
  prctl(PR_SET_PDEATHSIG, SIGTERM);  // nobody would take its result
  const int nothing = open("/dev/null", O_RDONLY), out = open(log, O_WRONLY | O_CREAT | O_TRUNC, 0644);
  if (nothing < 0 || out < 0 || dup2(nothing, 0) < 0 || dup2(out, 1) < 0 || dup2(out, 2) < 0) return errno;
  for (const auto& [name, value] : environment)
    if (setenv(name.c_str(), value.c_str(), 1) != 0) return errno;
  execvp(words.front(), words.data());
  return errno;
}

}  // namespace

ProcessCost run_measured(const std::vector<std::string>& command, const std::map<std::string, std::string>& environment,
                         const std::filesystem::path& log) {
  std::vector<char*> words;
  for (const std::string& word : command) words.push_back(const_cast<char*>(word.c_str()));
  words.push_back(nullptr);
  const std::vector<std::pair<std::string, std::string>> variables(environment.begin(), environment.end());
  int failure[2];  // closed by a program that starts
  if (pipe2(failure, O_CLOEXEC) != 0) throw std::runtime_error(std::string("no pipe: ") + std::strerror(errno));
  const auto start = std::chrono::steady_clock::now();
  const pid_t child = fork();
  if (child < 0) throw std::runtime_error(command.front() + " could not be started: " + std::strerror(errno));
  if (child == 0) {
    const int error = become(words, variables, log.c_str());
    [[maybe_unused]] const auto written = write(failure[1], &error, sizeof error);
    _exit(127);
  }
  close(failure[1]);
  int error = 0;
  const bool has_failed = read(failure[0], &error, sizeof error) == sizeof error;
  close(failure[0]);
  int status = 0;
  rusage usage{};
  while (wait4(child, &status, 0, &usage) < 0)
    if (errno != EINTR) throw std::runtime_error(command.front() + " was lost: " + std::strerror(errno));
  if (has_failed) throw std::runtime_error(command.front() + " could not be started: " + std::strerror(error));
  ProcessCost cost;
  cost.exit_code = WIFSIGNALED(status) ? 128 + WTERMSIG(status) : WEXITSTATUS(status);
  cost.cpu_seconds = seconds(usage.ru_utime) + seconds(usage.ru_stime);
  cost.wall_seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  cost.peak_megabytes = static_cast<double>(usage.ru_maxrss) / 1024;
  return cost;
}

std::filesystem::path find_program(const std::string& name) {
  const char* path = std::getenv("PATH");
  std::istringstream folders(path ? path : "");
  for (std::string folder; std::getline(folders, folder, ':');) {
    const std::filesystem::path candidate = std::filesystem::path(folder) / name;
    if (!folder.empty() && access(candidate.c_str(), X_OK) == 0 && !std::filesystem::is_directory(candidate))
      return candidate;
  }
  return {};
}

}  // namespace saltus::benchmark
