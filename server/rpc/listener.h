#pragma once

#include "server/rpc/authorisation.h"

#include <grpcpp/security/server_credentials.h>

#include <chrono>
#include <memory>
#include <string>

namespace saltus::server {

/// Where the certificates of mutual TLS are, as PEM files. They are read again when they change, and hold for new
/// connections from then on.
struct TlsFiles {
  std::string certificate;       ///< the daemon's own, followed by what its authority needs
  std::string key;               ///< of `certificate`
  std::string client_authority;  ///< clients need a certificate of one of these
  std::chrono::seconds reload_interval{10};

  bool operator==(const TlsFiles&) const = default;
};

/// Throws InvalidInput when a file cannot be read, or the key is not the certificate's.
void require_usable(const TlsFiles& files);

/// Mutual TLS, with the gate of `authorisation` before every call.
std::shared_ptr<grpc::ServerCredentials> tls_credentials(const TlsFiles& files, const Authorisation& authorisation);

}  // namespace saltus::server
