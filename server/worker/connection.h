#pragma once

#include "client/lib/channel.h"

#include <string>
#include <vector>

namespace CLI {
class App;
}

namespace saltus::worker {

/// Where the daemon is, and how this worker is let in there.
struct Connection {
  std::string server;  ///< unix:/path or host:port
  // Files for mutual TLS, PEM: all or none.
  std::string authority, certificate, key;

  /// Reads the files. Throws InvalidInput when one is missing or cannot be read, and when images would go to another
  /// machine without TLS.
  client::TlsIdentity identity() const;
  /// The options that say the same to another worker.
  std::vector<std::string> options() const;
};

/// Adds --server, --tls-ca, --tls-cert and --tls-key.
void add_options(CLI::App& app, Connection& connection);

}  // namespace saltus::worker
