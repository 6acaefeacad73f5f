#pragma once

#include <string>

namespace saltus::server {

/// Where the daemon listens: a unix socket, or a port of the loopback interface.
struct ListenAddress {
  enum class Kind { UnixSocket, Loopback };
  Kind kind = Kind::UnixSocket;
  std::string path;  ///< UnixSocket only
  std::string host;  ///< Loopback only
  int port = 0;      ///< Loopback only; 0: one that is free

  std::string to_text() const;
};

/// "unix:/path", "127.0.0.1:port", "localhost:port" or "[::1]:port". Throws InvalidInput for anything else.
ListenAddress parse_listen_address(const std::string& text);

}  // namespace saltus::server
