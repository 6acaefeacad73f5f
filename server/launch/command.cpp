#include "server/launch/command.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

namespace saltus::server {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::size_t kMostOutput = std::size_t{64} << 20;
constexpr std::size_t kMostErrors = std::size_t{64} << 10;

class Descriptor {
 public:
  explicit Descriptor(int number = -1) : number_(number) {}
  ~Descriptor() { close(); }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  void close() {
    if (number_ >= 0) ::close(number_);
    number_ = -1;
  }
  void reset(int number) {
    close();
    number_ = number;
  }
  int get() const { return number_; }

 private:
  int number_;
};

struct Pipe {
  Descriptor reading, writing;
  bool open() {
    int ends[2];
    return ::pipe2(ends, O_CLOEXEC) == 0 && take(ends);
  }
  /// Writing to it when nobody reads any more is an error, not a signal.
  bool open_as_socket() {
    int ends[2];
    return ::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) == 0 && take(ends);
  }

 private:
  bool take(const int* ends) {
    reading.reset(ends[0]);
    writing.reset(ends[1]);
    return true;
  }
};

/// What the daemon was started with, less what would make these programs answer something else.
std::vector<char*> environment_of_command() {
  std::vector<char*> kept;
  for (char** variable = environ; *variable; ++variable) {
    const std::string_view text = *variable;
    if (!text.starts_with("SQUEUE_") && !text.starts_with("SCANCEL_")) kept.push_back(*variable);
  }
  kept.push_back(nullptr);
  return kept;
}

int spawn(const Command& command, const Pipe& input, const Pipe& output, const Pipe& errors, pid_t& pid) {
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, input.reading.get(), STDIN_FILENO);
  posix_spawn_file_actions_adddup2(&actions, output.writing.get(), STDOUT_FILENO);
  posix_spawn_file_actions_adddup2(&actions, errors.writing.get(), STDERR_FILENO);
  posix_spawn_file_actions_addclosefrom_np(&actions, STDERR_FILENO + 1);
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP | POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
  posix_spawnattr_setpgroup(&attributes, 0);
  sigset_t signals;
  sigemptyset(&signals);
  posix_spawnattr_setsigmask(&attributes, &signals);
  sigfillset(&signals);
  posix_spawnattr_setsigdefault(&attributes, &signals);
  std::vector<char*> arguments;
  for (const std::string& argument : command.arguments) arguments.push_back(const_cast<char*>(argument.c_str()));
  arguments.push_back(nullptr);
  const int code =
      posix_spawnp(&pid, arguments.front(), &actions, &attributes, arguments.data(), environment_of_command().data());
  posix_spawn_file_actions_destroy(&actions);
  posix_spawnattr_destroy(&attributes);
  return code;
}

/// Takes what there is; closes at the end. What is too much is read and dropped, so that the command comes to its end.
void drain(Descriptor& from, std::string& text, std::size_t most) {
  char bytes[65536];
  const ssize_t count = ::read(from.get(), bytes, sizeof bytes);
  if (count > 0) {
    text.append(bytes, std::min(static_cast<std::size_t>(count), most - text.size()));
  } else if (count == 0 || (errno != EINTR && errno != EAGAIN)) {
    from.close();
  }
}

void feed(Descriptor& to, std::string_view& rest) {
  const ssize_t count = rest.empty() ? 0 : ::send(to.get(), rest.data(), rest.size(), MSG_NOSIGNAL);
  if (count > 0) rest.remove_prefix(static_cast<std::size_t>(count));
  // One that does not want it all is no error.
  if (rest.empty() || (count < 0 && errno != EINTR && errno != EAGAIN)) to.close();
}

}  // namespace

std::string describe(const CommandResult& result) {
  const std::string text = result.errors.empty() ? result.output : result.errors;
  const auto last = text.find_last_not_of(" \n");
  if (result.end == CommandResult::End::Exited && last != std::string::npos) {
    const auto before = text.find_last_of('\n', last);
    const auto begin = before == std::string::npos ? 0 : before + 1;
    return text.substr(begin, std::min<std::size_t>(last + 1 - begin, 500));
  }
  switch (result.end) {
    case CommandResult::End::Exited:
      return "it ended with code " + std::to_string(result.code);
    case CommandResult::End::Signalled:
      return "it was ended by signal " + std::to_string(result.code);
    case CommandResult::End::TimedOut:
      return "it did not come to an end in time";
    case CommandResult::End::Stopped:
      return "it was stopped with the daemon";
    case CommandResult::End::NotStarted:
      return std::string("it could not be started: ") + std::strerror(result.code);
  }
  return "";
}

CommandResult run_command(const Command& command, std::chrono::milliseconds limit, std::stop_token stop) {
  CommandResult result;
  Pipe input, output, errors;
  const Descriptor stopped(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK));
  pid_t pid = 0;
  if (!input.open_as_socket() || !output.open() || !errors.open() || stopped.get() < 0) {
    result.code = errno;
    return result;
  }
  if (const int code = spawn(command, input, output, errors, pid); code != 0) {
    result.code = code;
    return result;
  }
  // glibc 2.36 declares this without C linkage. Readable when the child has ended, whoever still holds its pipes.
  const Descriptor child(static_cast<int>(::syscall(SYS_pidfd_open, pid, 0)));
  if (child.get() < 0) {
    result.code = errno;
    ::kill(-pid, SIGKILL);
    ::waitpid(pid, nullptr, 0);
    return result;
  }
  const std::stop_callback on_stop(stop, [&stopped] {
    const std::uint64_t one = 1;
    [[maybe_unused]] const ssize_t count = ::write(stopped.get(), &one, sizeof one);
  });
  input.reading.close();
  output.writing.close();
  errors.writing.close();
  for (const Descriptor* end : {&input.writing, &output.reading, &errors.reading})
    ::fcntl(end->get(), F_SETFL, O_NONBLOCK);
  std::string_view rest = command.input;
  if (rest.empty()) input.writing.close();
  const auto until = Clock::now() + limit;
  bool has_ended = false;
  while (output.reading.get() >= 0 || errors.reading.get() >= 0 || !has_ended) {
    pollfd polled[] = {{input.writing.get(), POLLOUT, 0},
                       {output.reading.get(), POLLIN, 0},
                       {errors.reading.get(), POLLIN, 0},
                       {has_ended ? -1 : child.get(), POLLIN, 0},
                       {stopped.get(), POLLIN, 0}};
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(until - Clock::now()).count();
    // What a child of the ended command holds open is not waited for.
    const int answer =
        ::poll(polled, std::size(polled), has_ended ? 0 : static_cast<int>(std::clamp<long>(left, 0, 1000)));
    if (answer < 0 && errno != EINTR) break;
    if (answer == 0 && has_ended) break;
    if (polled[4].revents || Clock::now() >= until) {
      result.end = polled[4].revents ? CommandResult::End::Stopped : CommandResult::End::TimedOut;
      break;
    }
    if (answer <= 0) continue;
    if (polled[0].revents) feed(input.writing, rest);
    if (polled[1].revents) drain(output.reading, result.output, kMostOutput);
    if (polled[2].revents) drain(errors.reading, result.errors, kMostErrors);
    if (polled[3].revents) has_ended = true;
  }
  // The command, if it is still there, and whatever it has left behind.
  ::kill(-pid, SIGKILL);
  int status = 0;
  while (::waitpid(pid, &status, 0) < 0 && errno == EINTR) {
  }
  if (result.end == CommandResult::End::TimedOut || result.end == CommandResult::End::Stopped) return result;
  result.end = WIFEXITED(status) ? CommandResult::End::Exited : CommandResult::End::Signalled;
  result.code = WIFEXITED(status) ? WEXITSTATUS(status) : WTERMSIG(status);
  return result;
}

}  // namespace saltus::server
