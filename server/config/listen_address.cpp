#include "server/config/listen_address.h"

#include "core/support/errors.h"

#include <sys/un.h>

#include <charconv>

namespace saltus::server {
namespace {

constexpr std::size_t kLongestPath = sizeof(sockaddr_un::sun_path) - 1;

int parse_port(const std::string& text, const std::string& port) {
  int number = -1;
  const char* end = port.data() + port.size();
  const auto parsed = std::from_chars(port.data(), end, number);
  if (parsed.ec != std::errc() || parsed.ptr != end || number < 0 || number > 65535)
    throw InvalidInput("--listen is " + text + "; the port must be 0 (any that is free) to 65535");
  return number;
}

}  // namespace

std::string ListenAddress::to_text() const {
  return kind == Kind::UnixSocket ? "unix:" + path : host + ":" + std::to_string(port);
}

ListenAddress parse_listen_address(const std::string& text, Transport transport) {
  if (text.starts_with("unix:")) {
    const std::string path = text.substr(5);
    if (path.empty() || path.front() != '/')
      throw InvalidInput("--listen is " + text + "; the path of the socket must begin with /");
    if (path.size() > kLongestPath)
      throw InvalidInput("--listen is " + text + "; the path of a socket can have " + std::to_string(kLongestPath) +
                         " characters, choose a shorter one with --listen unix:PATH");
    return {ListenAddress::Kind::UnixSocket, path, "", 0};
  }
  const auto colon = text.rfind(':');
  if (colon == std::string::npos || colon == 0)
    throw InvalidInput("--listen is " + text + "; it must be unix:/path or 127.0.0.1:port");
  const std::string host = text.substr(0, colon);
  if (transport == Transport::MutualTls)
    return {ListenAddress::Kind::Protected, "", host, parse_port(text, text.substr(colon + 1))};
  if (host != "127.0.0.1" && host != "localhost" && host != "[::1]")
    throw InvalidInput(
        "--listen is " + text +
        "; only this machine (unix:/path or 127.0.0.1:port) is served, because without mutual TLS anyone on the "
        "network "
        "could read the images; give --tls-cert, --tls-key, --tls-client-ca and --roles, or use an SSH tunnel");
  return {ListenAddress::Kind::Loopback, "", host, parse_port(text, text.substr(colon + 1))};
}

}  // namespace saltus::server
