#include "client/cli/connection.h"

#include "core/support/errors.h"

#include <CLI/CLI.hpp>

#include <algorithm>
#include <fstream>
#include <sstream>

namespace saltus::cli {
namespace {

std::string content_of(const char* option, const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  if (file) text << file.rdbuf();
  if (!file) throw InvalidInput(std::string(option) + " is " + path + ", which cannot be read");
  return text.str();
}

bool is_this_machine(const std::string& host) {
  return host == "localhost" || host == "[::1]" || host.starts_with("127.");
}

client::TlsIdentity read_tls(const ServerChoice& server) {
  const std::pair<const char*, bool> needed[] = {{"--tls-ca", server.authority.empty()},
                                                 {"--tls-cert", server.certificate.empty()},
                                                 {"--tls-key", server.key.empty()}};
  const auto is_missing = [](const auto& option) { return option.second; };
  if (std::all_of(std::begin(needed), std::end(needed), is_missing)) return {};
  if (const auto* missing = std::find_if(std::begin(needed), std::end(needed), is_missing); missing != std::end(needed))
    throw InvalidInput(std::string(missing->first) +
                       " is not given; mutual TLS needs --tls-ca, --tls-cert and --tls-key");
  return {content_of("--tls-ca", server.authority), content_of("--tls-cert", server.certificate),
          content_of("--tls-key", server.key)};
}

}  // namespace

CLI::Option* add_server_option(CLI::App& app, ServerChoice& server) {
  CLI::Option* option = app.add_option("--server", server.address, "Address of saltusd: unix:/path or host:port")
                            ->envname("SALTUS_SERVER")
                            ->type_name("ADDRESS");
  add_tls_options(app, server);
  return option;
}

void add_tls_options(CLI::App& app, ServerChoice& server) {
  app.add_option("--tls-ca", server.authority,
                 "Authority of the server's certificate, PEM; for a server beyond this machine")
      ->envname("SALTUS_TLS_CA")
      ->type_name("FILE");
  app.add_option("--tls-cert", server.certificate, "Your certificate, PEM")
      ->envname("SALTUS_TLS_CERT")
      ->type_name("FILE");
  app.add_option("--tls-key", server.key, "The private key of --tls-cert, PEM")
      ->envname("SALTUS_TLS_KEY")
      ->type_name("FILE");
}

client::CallSettings call_settings(const ServerChoice& server, std::stop_token stop) {
  const std::string& address = server.address;
  if (address.empty())
    throw InvalidInput("no server is given; use --server unix:/path or --server host:port, or set SALTUS_SERVER");
  const bool is_socket = address.starts_with("unix:") && address.size() > 5;
  const auto colon = address.rfind(':');
  const bool is_host_and_port = colon != std::string::npos && colon > 0 && colon + 1 < address.size() &&
                                address.find_first_not_of("0123456789", colon + 1) == std::string::npos;
  if (!is_socket && !is_host_and_port)
    throw InvalidInput("--server is " + address + "; it must be unix:/path or host:port");
  client::CallSettings settings{
      .address = address, .tls = {}, .retry = {}, .stop = std::move(stop), .blobs = server.blobs};
  if (is_socket) return settings;
  settings.tls = read_tls(server);
  if (!settings.tls.is_set() && !is_this_machine(address.substr(0, colon)))
    throw InvalidInput("--server is " + address +
                       ", beyond this machine; give --tls-ca, --tls-cert and --tls-key, since images must not cross a "
                       "network in the clear");
  return settings;
}

}  // namespace saltus::cli
