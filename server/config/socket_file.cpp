#include "server/config/socket_file.h"

#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <stdexcept>

namespace saltus::server {

void require_nobody_listens(const std::string& path) {
  const int descriptor = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (descriptor < 0) throw std::runtime_error(std::string("cannot make a socket: ") + std::strerror(errno));
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::strncpy(address.sun_path, path.c_str(), sizeof address.sun_path - 1);
  const int result = ::connect(descriptor, reinterpret_cast<const sockaddr*>(&address), sizeof address);
  ::close(descriptor);
  if (result == 0)
    throw std::runtime_error("--listen is unix:" + path +
                             ", where another program listens; stop it or choose another path");
}

void restrict_socket(const std::string& path) {
  if (::chmod(path.c_str(), 0660) != 0)
    throw std::runtime_error("cannot set the permissions of " + path + ": " + std::strerror(errno));
}

}  // namespace saltus::server
