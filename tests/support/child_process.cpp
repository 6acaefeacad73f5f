#include "tests/support/child_process.h"

#include <cerrno>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <utility>

#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

namespace saltus::testing_support {
namespace {

using Clock = std::chrono::steady_clock;

[[noreturn]] void fail(const std::string& what) { throw std::runtime_error(what + ": " + std::strerror(errno)); }

int milliseconds_until(Clock::time_point until) {
  return static_cast<int>(
      std::max<std::int64_t>(0, std::chrono::duration_cast<std::chrono::milliseconds>(until - Clock::now()).count()));
}

std::vector<std::string> environment_with(const std::map<std::string, std::string>& changes) {
  std::vector<std::string> result;
  for (char** entry = environ; *entry; ++entry) {
    const std::string text = *entry;
    if (!changes.count(text.substr(0, text.find('=')))) result.push_back(text);
  }
  for (const auto& [name, value] : changes) result.push_back(name + "=" + value);
  return result;
}

std::vector<char*> pointers_to(std::vector<std::string>& words) {
  std::vector<char*> pointers;
  for (std::string& word : words) pointers.push_back(word.data());
  pointers.push_back(nullptr);
  return pointers;
}

}  // namespace

ChildProcess::ChildProcess(const std::vector<std::string>& command,
                           const std::map<std::string, std::string>& environment) {
  int out[2], err[2];
  if (pipe2(out, O_CLOEXEC) != 0 || pipe2(err, O_CLOEXEC) != 0) fail("pipe");
  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_addopen(&files, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_adddup2(&files, out[1], STDOUT_FILENO);
  posix_spawn_file_actions_adddup2(&files, err[1], STDERR_FILENO);
  std::vector<std::string> words = command, variables = environment_with(environment);
  const int error =
      posix_spawn(&id_, command[0].c_str(), &files, nullptr, pointers_to(words).data(), pointers_to(variables).data());
  posix_spawn_file_actions_destroy(&files);
  close(out[1]);
  close(err[1]);
  out_end_ = out[0];
  err_end_ = err[0];
  if (error != 0) {
    id_ = -1;
    errno = error;
    fail(command[0]);
  }
}

ChildProcess::ChildProcess(ChildProcess&& other) noexcept
    : id_(std::exchange(other.id_, -1)),
      out_end_(std::exchange(other.out_end_, -1)),
      err_end_(std::exchange(other.err_end_, -1)),
      exit_code_(other.exit_code_),
      out_(std::move(other.out_)),
      err_(std::move(other.err_)) {}

ChildProcess::~ChildProcess() {
  if (id_ > 0 && !exit_code_) {
    kill(id_, SIGKILL);
    waitpid(id_, nullptr, 0);
  }
  if (out_end_ >= 0) close(out_end_);
  if (err_end_ >= 0) close(err_end_);
}

void ChildProcess::signal(int number) const {
  if (!exit_code_) kill(id_, number);
}

bool ChildProcess::read_more(Clock::time_point until) {
  pollfd ends[2] = {{out_end_, POLLIN, 0}, {err_end_, POLLIN, 0}};
  if (out_end_ < 0 && err_end_ < 0) return false;
  const int answer = poll(ends, 2, milliseconds_until(until));
  if (answer < 0 && errno == EINTR) return true;
  if (answer <= 0) throw std::runtime_error("the child did not get on in time; its output:\n" + out_ + err_);
  const auto drain = [](const pollfd& end, int& descriptor, std::string& text) {
    if (!end.revents) return;
    char buffer[4096];
    const ssize_t got = read(descriptor, buffer, sizeof buffer);
    if (got > 0) {
      text.append(buffer, static_cast<std::size_t>(got));
    } else if (got == 0 || errno != EINTR) {
      close(descriptor);
      descriptor = -1;
    }
  };
  drain(ends[0], out_end_, out_);
  drain(ends[1], err_end_, err_);
  return true;
}

std::string ChildProcess::wait_for_output(const std::string& text) {
  const auto until = Clock::now() + patience;
  while (true) {
    for (const std::string* stream : {&out_, &err_}) {
      const auto at = stream->find(text);
      const auto end = at == std::string::npos ? at : stream->find('\n', at);
      if (end == std::string::npos) continue;
      const auto begin = stream->rfind('\n', at);
      return stream->substr(begin == std::string::npos ? 0 : begin + 1,
                            end - (begin == std::string::npos ? 0 : begin + 1));
    }
    if (!read_more(until))
      throw std::runtime_error("the child ended without '" + text + "'; its output:\n" + out_ + err_);
  }
}

int ChildProcess::wait() {
  const auto until = Clock::now() + patience;
  while (read_more(until)) continue;
  if (!exit_code_) {
    if (!ProcessHandle(id_).ends_within(std::chrono::milliseconds(milliseconds_until(until))))
      throw std::runtime_error("the child closed its output but does not end");
    int status = 0;
    waitpid(id_, &status, 0);
    exit_code_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  }
  return *exit_code_;
}

std::vector<pid_t> ChildProcess::children() const {
  std::vector<pid_t> found;
  for (const auto& thread : std::filesystem::directory_iterator("/proc/" + std::to_string(id_) + "/task")) {
    std::ifstream in(thread.path() / "children");
    for (pid_t child; in >> child;) found.push_back(child);
  }
  return found;
}

// glibc 2.36 declares pidfd_open without C linkage.
ProcessHandle::ProcessHandle(pid_t id) : descriptor_(static_cast<int>(syscall(SYS_pidfd_open, id, 0))) {
  if (descriptor_ < 0) fail("pidfd_open");
}

ProcessHandle::~ProcessHandle() {
  if (descriptor_ >= 0) close(descriptor_);
}

ProcessHandle::ProcessHandle(ProcessHandle&& other) noexcept : descriptor_(std::exchange(other.descriptor_, -1)) {}

bool ProcessHandle::ends_within(std::chrono::milliseconds time) const {
  pollfd end{descriptor_, POLLIN, 0};
  const auto until = Clock::now() + time;
  while (true) {
    const int answer = poll(&end, 1, milliseconds_until(until));
    if (answer > 0) return true;
    if (answer == 0) return false;
    if (errno != EINTR) fail("poll");
  }
}

}  // namespace saltus::testing_support
