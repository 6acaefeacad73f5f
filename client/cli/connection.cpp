#include "client/cli/connection.h"

#include "core/support/errors.h"

#include <CLI/CLI.hpp>

namespace saltus::cli {

CLI::Option* add_server_option(CLI::App& app, std::string& address) {
  return app.add_option("--server", address, "Address of saltusd: unix:/path or host:port")
      ->envname("SALTUS_SERVER")
      ->type_name("ADDRESS");
}

client::CallSettings call_settings(const std::string& address, std::stop_token stop) {
  if (address.empty())
    throw InvalidInput("no server is given; use --server unix:/path or --server host:port, or set SALTUS_SERVER");
  const bool is_socket = address.starts_with("unix:") && address.size() > 5;
  const auto colon = address.rfind(':');
  const bool is_host_and_port = colon != std::string::npos && colon > 0 && colon + 1 < address.size() &&
                                address.find_first_not_of("0123456789", colon + 1) == std::string::npos;
  if (!is_socket && !is_host_and_port)
    throw InvalidInput("--server is " + address + "; it must be unix:/path or host:port");
  return {.address = address, .retry = {}, .stop = std::move(stop)};
}

}  // namespace saltus::cli
