#include "client/cli/interrupts.h"

#include <cerrno>
#include <csignal>
#include <stdexcept>
#include <system_error>

#include <fcntl.h>
#include <unistd.h>

namespace saltus::cli {
namespace {

constexpr char signal_mark = 's', end_mark = 'e';

// A handler may do next to nothing; it writes one byte for the thread to read.
int write_end = -1;
struct sigaction former_int, former_term, former_hup;

void on_signal(int) {
  const int saved = errno;
  [[maybe_unused]] const ssize_t written = write(write_end, &signal_mark, 1);
  errno = saved;
}

}  // namespace

Interrupts::Interrupts(std::function<void(int)> on_interrupt) : on_interrupt_(std::move(on_interrupt)) {
  int ends[2];
  if (pipe2(ends, O_CLOEXEC) != 0) throw std::system_error(errno, std::generic_category(), "pipe");
  read_end_ = ends[0];
  write_end = ends[1];
  thread_ = std::thread([this] {
    char mark = 0;
    while (true) {
      const ssize_t got = read(read_end_, &mark, 1);
      if (got < 0 && errno == EINTR) continue;
      if (got != 1 || mark == end_mark) return;
      on_interrupt_(++count_);
    }
  });
  struct sigaction action {};
  action.sa_handler = on_signal;
  action.sa_flags = SA_RESTART;
  sigaction(SIGINT, &action, &former_int);
  sigaction(SIGTERM, &action, &former_term);
  // What nohup has started goes on when its terminal has gone.
  sigaction(SIGHUP, nullptr, &former_hup);
  if (former_hup.sa_handler != SIG_IGN) sigaction(SIGHUP, &action, nullptr);
}

Interrupts::~Interrupts() {
  sigaction(SIGINT, &former_int, nullptr);
  sigaction(SIGTERM, &former_term, nullptr);
  sigaction(SIGHUP, &former_hup, nullptr);
  [[maybe_unused]] const ssize_t written = write(write_end, &end_mark, 1);
  thread_.join();
  close(read_end_);
  close(write_end);
}

}  // namespace saltus::cli
