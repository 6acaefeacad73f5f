#pragma once

#include <string>

namespace saltus::server {

/// gRPC replaces a socket file without asking whether somebody still listens on it: throws std::runtime_error when
/// somebody does.
void require_nobody_listens(const std::string& path);

/// Lets owner and group connect, nobody else. Throws std::runtime_error.
void restrict_socket(const std::string& path);

}  // namespace saltus::server
