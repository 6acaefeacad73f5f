#include "server/worker/connection.h"

#include "core/support/errors.h"

#include <CLI/CLI.hpp>

#include <fstream>
#include <sstream>

namespace saltus::worker {
namespace {

std::string content_of(const char* option, const std::string& path) {
  if (path.empty())
    throw InvalidInput(std::string(option) + " is not given; mutual TLS needs --tls-ca, --tls-cert and --tls-key");
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  if (file) text << file.rdbuf();
  if (!file) throw InvalidInput(std::string(option) + " is " + path + ", which cannot be read");
  return text.str();
}

bool is_this_machine(const std::string& server) {
  if (server.starts_with("unix:")) return true;
  const std::string host = server.substr(0, server.rfind(':'));
  return host == "localhost" || host == "[::1]" || host.starts_with("127.");
}

}  // namespace

client::TlsIdentity Connection::identity() const {
  if (!authority.empty() || !certificate.empty() || !key.empty())
    return {content_of("--tls-ca", authority), content_of("--tls-cert", certificate), content_of("--tls-key", key)};
  if (!is_this_machine(server))
    throw InvalidInput("--server is " + server +
                       ", beyond this machine; give --tls-ca, --tls-cert and --tls-key, since images must not cross a "
                       "network in the clear");
  return {};
}

std::vector<std::string> Connection::options() const {
  std::vector<std::string> words{"--server", server};
  for (const auto& [option, value] :
       {std::pair("--tls-ca", authority), {"--tls-cert", certificate}, {"--tls-key", key}})
    if (!value.empty()) words.insert(words.end(), {option, value});
  return words;
}

void add_options(CLI::App& app, Connection& connection) {
  app.add_option("--server", connection.server, "Address of saltusd: unix:/path or host:port")->required();
  app.add_option("--tls-ca", connection.authority,
                 "Authority of the daemon's certificate, PEM; for a daemon beyond this machine")
      ->type_name("FILE");
  app.add_option("--tls-cert", connection.certificate, "This worker's certificate, PEM")->type_name("FILE");
  app.add_option("--tls-key", connection.key, "The private key of --tls-cert, PEM")->type_name("FILE");
}

}  // namespace saltus::worker
