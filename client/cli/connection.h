#pragma once

#include "client/lib/channel.h"

#include <stop_token>
#include <string>

namespace CLI {
class App;
class Option;
}  // namespace CLI

namespace saltus::cli {

/// Which daemon, and how to be let in there.
struct ServerChoice {
  std::string address;  ///< unix:/path or host:port
  // Files for mutual TLS: all or none.
  std::string authority;
  std::string certificate;
  std::string key;
  client::SharedBlobs blobs{};
};

/// Adds --server, which the environment variable SALTUS_SERVER stands in for, and the options of add_tls_options.
CLI::Option* add_server_option(CLI::App& app, ServerChoice& server);

/// Adds --tls-ca, --tls-cert and --tls-key; SALTUS_TLS_CA, SALTUS_TLS_CERT and SALTUS_TLS_KEY stand in for them.
void add_tls_options(CLI::App& app, ServerChoice& server);

/// How to call that daemon. Throws InvalidInput when the address is empty or is neither unix:/path nor host:port, when
/// a file cannot be read, and when images would go to another machine without TLS.
client::CallSettings call_settings(const ServerChoice& server, std::stop_token stop = {});

}  // namespace saltus::cli
