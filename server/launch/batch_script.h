#pragma once

#include "server/launch/command.h"

#include <cstdint>
#include <string>
#include <vector>

namespace saltus::server {

/// Files for mutual TLS, as the machines of the workers name them; all empty, or none.
struct WorkerTls {
  std::string authority, certificate, key;
};

/// What is the same for all workers of a batch system.
struct BatchSettings {
  std::string worker;          ///< the program, as the nodes name it
  std::string server_address;  ///< where they find the daemon
  WorkerTls tls;
  /// The daemon's data folder, as the nodes name it: tokens, what workers print and inputs are then there. "": they
  /// share no folder with the daemon.
  std::string shared_data;
  std::vector<std::string> options;  ///< more of sbatch's; what they say goes before what we say
};

/// A text that a POSIX shell takes for one word, whatever is in it.
std::string shell_quoted(const std::string& text);

/// What one submission asks for.
struct BatchRequest {
  std::string name;
  int threads = 1;
  std::int64_t memory_bytes = 0;              ///< 0: what the batch system gives
  std::int64_t wall_seconds = 0;              ///< the same
  std::string output = "/dev/null";           ///< file on the node for what the worker prints
  std::vector<std::string> worker_arguments;  ///< beside those of the settings
  std::string input;                          ///< what the worker reads from standard input
  int array_size = 0;                         ///< so many of the same; 0: one that is no array
};

/// The call of sbatch. The script goes through its standard input, and what is secret in that of the worker: the
/// arguments and environment of both are visible to others.
Command submission(const BatchSettings& settings, const BatchRequest& request);

}  // namespace saltus::server
