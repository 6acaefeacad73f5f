#pragma once

#include <string>

namespace saltus::server {

/// What protects a port.
enum class Transport { Plain, MutualTls };

/// Where the daemon listens: a unix socket, a port of the loopback interface, or any port with mutual TLS.
struct ListenAddress {
  enum class Kind { UnixSocket, Loopback, Protected };
  Kind kind = Kind::UnixSocket;
  std::string path;  ///< UnixSocket only
  std::string host;  ///< of a port
  int port = 0;      ///< 0: one that is free

  std::string to_text() const;
  bool operator==(const ListenAddress&) const = default;
};

/// "unix:/path" or "host:port"; all ports are Protected with mutual TLS, without it only 127.0.0.1, localhost and [::1]
/// are accepted. Throws InvalidInput.
ListenAddress parse_listen_address(const std::string& text, Transport transport = Transport::Plain);

}  // namespace saltus::server
