#pragma once

#include "client/lib/channel.h"

#include <stop_token>
#include <string>

namespace CLI {
class App;
class Option;
}  // namespace CLI

namespace saltus::cli {

/// Adds --server, which the environment variable SALTUS_SERVER stands in for.
CLI::Option* add_server_option(CLI::App& app, std::string& address);

/// How to call the daemon at `address`. Throws InvalidInput when that is empty or is neither unix:/path nor host:port.
client::CallSettings call_settings(const std::string& address, std::stop_token stop = {});

}  // namespace saltus::cli
