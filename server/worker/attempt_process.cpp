#include "server/worker/attempt_process.h"

#include "core/support/available_cores.h"
#include "core/support/errors.h"
#include "server/launch/worker_environment.h"
#include "server/worker/work_folder.h"
#include "server/worker/worker_session.h"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <system_error>
#include <utility>

namespace saltus::worker {
namespace {

void write_secret(const std::filesystem::path& file, const std::string& text) {
  const int descriptor = ::open(file.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
  const bool is_written =
      descriptor >= 0 && ::write(descriptor, text.data(), text.size()) == static_cast<ssize_t>(text.size());
  if (descriptor >= 0) ::close(descriptor);
  if (!is_written) throw FileError("the token file cannot be written");
}

std::vector<std::string> attempt_environment(const std::filesystem::path& folder, int threads) {
  std::vector<std::pair<std::string, std::string>> own;
  if (threads > 0) own = server::worker_variables(threads, threads <= available_cores(), std::getenv("GLIBC_TUNABLES"));
  own.emplace_back("TMPDIR", folder.string());
  return server::environment_with(own);
}

pid_t spawn(std::vector<std::string> words, std::vector<std::string> variables) {
  const auto pointers = [](std::vector<std::string>& texts) {
    std::vector<char*> list;
    for (std::string& text : texts) list.push_back(text.data());
    list.push_back(nullptr);
    return list;
  };
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addclosefrom_np(&actions, STDERR_FILENO + 1);
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP | POSIX_SPAWN_SETSIGMASK);
  posix_spawnattr_setpgroup(&attributes, 0);
  sigset_t none;
  sigemptyset(&none);
  posix_spawnattr_setsigmask(&attributes, &none);
  pid_t pid = 0;
  const int code =
      posix_spawn(&pid, "/proc/self/exe", &actions, &attributes, pointers(words).data(), pointers(variables).data());
  posix_spawn_file_actions_destroy(&actions);
  posix_spawnattr_destroy(&attributes);
  if (code != 0) throw std::system_error(code, std::generic_category(), "the attempt's process cannot be started");
  return pid;
}

}  // namespace

ProcessEnd run_attempt_process(const AttemptOrder& order, const std::stop_token& stop) {
  const WorkFolder folder;
  std::string token_file = order.token_file;
  if (token_file.empty()) {
    token_file = folder.path() / "token";
    write_secret(token_file, order.token);
  }
  std::vector<std::string> words{"saltus-worker"};
  words.insert(words.end(), order.options.begin(), order.options.end());
  words.insert(words.end(),
               {"--job", order.job_id, "--attempt", std::to_string(order.attempt), "--token-file", token_file});
  const pid_t pid = spawn(words, attempt_environment(folder.path(), order.threads));
  siginfo_t ended{};
  {
    // Until it is reaped below the number is the child's, also when it has ended.
    const std::stop_callback forward(stop, [pid] { ::kill(-pid, SIGTERM); });
    while (::waitid(P_PID, static_cast<id_t>(pid), &ended, WEXITED | WNOWAIT) != 0 && errno == EINTR) {
    }
  }
  // What the attempt has started must not outlive it.
  ::kill(-pid, SIGKILL);
  int status = 0;
  while (::waitpid(pid, &status, 0) < 0 && errno == EINTR) {
  }
  // It was asked to end before it could listen.
  if (stop.stop_requested() && WIFSIGNALED(status) && WTERMSIG(status) == SIGTERM) return {false, TerminatedExit};
  if (WIFSIGNALED(status)) return {true, WTERMSIG(status)};
  return {false, WEXITSTATUS(status)};
}

void end_like(const ProcessEnd& end) {
  if (end.is_signalled) {
    const rlimit none{0, 0};
    ::setrlimit(RLIMIT_CORE, &none);
    ::signal(end.number, SIG_DFL);
    sigset_t set;
    sigemptyset(&set);
    sigaddset(&set, end.number);
    sigprocmask(SIG_UNBLOCK, &set, nullptr);
    ::kill(::getpid(), end.number);
  }
  std::_Exit(end.is_signalled ? 128 + end.number : end.number);
}

}  // namespace saltus::worker
