#include "server/observe/service_manager.h"

#include "core/support/errors.h"

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <stdexcept>

namespace saltus::server {
namespace {

std::string take(const char* name) {
  const char* value = std::getenv(name);
  const std::string taken = value ? value : "";
  ::unsetenv(name);
  return taken;
}

long long number(const char* name, const std::string& text) {
  long long value = 0;
  const char* end = text.data() + text.size();
  const auto parsed = std::from_chars(text.data(), end, value);
  if (parsed.ec != std::errc() || parsed.ptr != end || value <= 0)
    throw InvalidInput(std::string(name) + " is '" + text +
                       "' in the environment; it must be a number above 0, or not be there");
  return value;
}

}  // namespace

ServiceManager ServiceManager::from_environment() {
  const std::string socket = take("NOTIFY_SOCKET"), time = take("WATCHDOG_USEC"), process = take("WATCHDOG_PID");
  if (!socket.empty() && ((socket[0] != '/' && socket[0] != '@') || socket.size() > sizeof(sockaddr_un::sun_path) - 1))
    throw InvalidInput("NOTIFY_SOCKET is '" + socket + "' in the environment; it must be the path of a socket");
  std::optional<std::chrono::microseconds> watchdog;
  const bool is_meant = process.empty() || number("WATCHDOG_PID", process) == ::getpid();
  if (!time.empty() && is_meant) watchdog = std::chrono::microseconds(number("WATCHDOG_USEC", time));
  return {socket, watchdog};
}

void ServiceManager::ready(const std::string& status) const { send("READY=1\nSTATUS=" + status); }
void ServiceManager::alive() const {
  if (watchdog_) send("WATCHDOG=1");
}
void ServiceManager::stopping() const { send("STOPPING=1\nSTATUS=ends its workers, whose jobs are queued again"); }

void ServiceManager::send(const std::string& message) const {
  if (socket_.empty()) return;
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::copy(socket_.begin(), socket_.end(), address.sun_path);
  if (socket_[0] == '@') address.sun_path[0] = '\0';
  const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + socket_.size());
  const int descriptor = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  const ssize_t sent = descriptor < 0
                           ? -1
                           : ::sendto(descriptor, message.data(), message.size(), MSG_NOSIGNAL | MSG_DONTWAIT,
                                      reinterpret_cast<const sockaddr*>(&address), size);
  const int error = errno;
  if (descriptor >= 0) ::close(descriptor);
  if (sent < 0)
    throw std::runtime_error("the service manager's socket " + socket_ + " does not take '" +
                             message.substr(0, message.find('\n')) + "': " + std::strerror(error));
}

}  // namespace saltus::server
