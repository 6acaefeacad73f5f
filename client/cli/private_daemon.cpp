#include "client/cli/private_daemon.h"

#include "core/support/available_cores.h"
#include "core/support/errors.h"
#include "core/support/thread_binding.h"

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <sstream>
#include <vector>

#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <sys/file.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

namespace saltus::cli {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr std::chrono::seconds start_patience{20};
constexpr std::chrono::seconds stop_patience{15};
constexpr int most_threads = 1024;  // that saltusd can be given; it refuses the job itself

[[noreturn]] void fail(const std::string& what) {
  throw FileError("the private saltusd could not be started: " + what + "; use --server to name a running one");
}

std::string last_line(const fs::path& file) {
  std::ifstream in(file);
  std::string last;
  for (std::string line; std::getline(in, line);)
    if (!line.empty()) last = line;
  return last;
}

struct Pipe {
  int read_end, write_end;
};

Pipe make_pipe() {
  int ends[2];
  if (pipe2(ends, O_CLOEXEC) != 0) fail(std::strerror(errno));
  return {ends[0], ends[1]};
}

/// True when the process has ended within `patience`; it is then reaped.
bool reap(pid_t process, std::chrono::milliseconds patience) {
  const int handle = static_cast<int>(syscall(SYS_pidfd_open, process, 0));
  pollfd ended{handle, POLLIN, 0};
  const auto until = Clock::now() + patience;
  int answer = 0;
  do {
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(until - Clock::now()).count();
    answer = poll(&ended, 1, static_cast<int>(std::max<std::int64_t>(left, 0)));
  } while (answer < 0 && errno == EINTR);
  close(handle);
  return answer > 0 && waitpid(process, nullptr, WNOHANG) == process;
}

}  // namespace

fs::path find_daemon() {
  std::vector<fs::path> folders;
  if (const char* chosen = std::getenv("SALTUS_BIN")) {
    folders = {chosen};
  } else {
    std::error_code error;
    folders.push_back(fs::read_symlink("/proc/self/exe", error).parent_path());
    std::istringstream path(std::getenv("PATH") ? std::getenv("PATH") : "");
    for (std::string folder; std::getline(path, folder, ':');) folders.emplace_back(folder);
  }
  for (const fs::path& folder : folders)
    if (const fs::path program = folder / "saltusd"; access(program.c_str(), X_OK) == 0) return program;
  throw FileError(
      "saltusd is not found beside this program, on the PATH or in $SALTUS_BIN; set SALTUS_BIN to its folder");
}

PrivateDaemon::PrivateDaemon(const Work& work)
    : program_(find_daemon()), address_("unix:" + folder_.socket().string()) {
  try {
    start(work);
    wait_until_it_listens();
  } catch (...) {
    stop();
    throw;
  }
}

PrivateDaemon::~PrivateDaemon() { stop(); }

/// That no other one holds the lock; from now on this one does, as long as it lives.
bool PrivateDaemon::is_first() {
  presence_ = ::open(program_.c_str(), O_RDONLY | O_CLOEXEC);
  if (presence_ < 0) return false;
  const bool is_first = ::flock(presence_, LOCK_EX | LOCK_NB) == 0;
  ::flock(presence_, LOCK_SH | LOCK_NB);  // where that fails, another one is just looking
  return is_first;
}

void PrivateDaemon::start(const Work& work) {
  release_thread();
  const Pipe to_daemon = make_pipe();
  stdin_write_end_ = to_daemon.write_end;
  const Pipe from_daemon = make_pipe();
  stdout_read_end_ = from_daemon.read_end;
  const std::string log = folder_.path() / "log";

  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_adddup2(&files, to_daemon.read_end, STDIN_FILENO);
  posix_spawn_file_actions_adddup2(&files, from_daemon.write_end, STDOUT_FILENO);
  posix_spawn_file_actions_addopen(&files, STDERR_FILENO, log.c_str(), O_WRONLY | O_CREAT | O_APPEND, 0600);
  // The daemon holds the folder too, as long as it lives. To itself: it then stays open in the daemon.
  if (folder_.lock() >= 0) posix_spawn_file_actions_adddup2(&files, folder_.lock(), folder_.lock());
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  // A group of its own: Ctrl-C is for this program, which cancels the job before it ends the daemon.
  posix_spawnattr_setpgroup(&attributes, 0);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);

  std::vector<std::string> words{program_, "--listen", address_, "--data", data(), "--exit-on-stdin-close",
                                 // It goes with this command, so it need not leave room for a day's work.
                                 "--disk-reserve", "64M", "--slots", std::to_string(work.jobs)};
  // A job that names no number of threads gets its share of the cores, so one alone has them all. One that does gets
  // what it asks for; of several the daemon then starts as many as the cores allow. A budget of more than the cores
  // tells it that others may want them (server/launch/local_launcher.cpp).
  const int cores = available_cores();
  const int each = work.threads > 0 ? std::min(work.threads, most_threads) : std::max(1, cores / work.jobs);
  const int all = is_first() || work.jobs > 1 ? std::max(cores, each) : most_threads;
  words.insert(words.end(), {"--threads-per-job", std::to_string(each), "--threads", std::to_string(all)});
  std::vector<char*> arguments;
  for (std::string& word : words) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  const int error = posix_spawn(&process_, program_.c_str(), &files, &attributes, arguments.data(), environ);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&files);
  close(to_daemon.read_end);
  close(from_daemon.write_end);
  if (error != 0) {
    process_ = -1;
    fail(program_.string() + ": " + std::strerror(error));
  }
}

void PrivateDaemon::wait_until_it_listens() {
  const auto until = Clock::now() + start_patience;
  std::string output;
  while (output.find("listening on") == std::string::npos) {
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(until - Clock::now()).count();
    pollfd readable{stdout_read_end_, POLLIN, 0};
    const int answer = left > 0 ? poll(&readable, 1, static_cast<int>(left)) : 0;
    if (answer < 0 && errno == EINTR) continue;
    if (answer <= 0) fail("it does not listen after " + std::to_string(start_patience.count()) + " s");
    char buffer[1024];
    const ssize_t got = read(stdout_read_end_, buffer, sizeof buffer);
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) {
      const std::string reason = last_line(folder_.path() / "log");
      fail(reason.empty() ? "it ended at once" : reason);
    }
    output.append(buffer, static_cast<std::size_t>(got));
  }
}

void PrivateDaemon::stop() {
  if (stdin_write_end_ >= 0) close(stdin_write_end_);
  if (process_ > 0 && !reap(process_, stop_patience)) {
    kill(process_, SIGKILL);
    waitpid(process_, nullptr, 0);
  }
  if (stdout_read_end_ >= 0) close(stdout_read_end_);
  if (presence_ >= 0) close(presence_);
  stdin_write_end_ = stdout_read_end_ = presence_ = -1;
  process_ = -1;
}

}  // namespace saltus::cli
