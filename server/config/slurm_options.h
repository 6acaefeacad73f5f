#pragma once

#include "server/config/listen_address.h"

#include <chrono>
#include <string>
#include <vector>

namespace CLI {
class App;
}

namespace saltus::server {

enum class LauncherKind { Local, Slurm };

/// What the options --slurm-... say. Paths are those of the nodes.
struct SlurmConfig {
  std::string server;  ///< "": the first address with mutual TLS, else that of this machine
  std::string authority, certificate, key;
  std::string worker;
  std::vector<std::string> options;
  std::string shared_data;
  double poll_seconds = 10;
  double patience_seconds = 600;
  int pilots = 0;
  double pilot_memory_gib = 4;
  int pilot_idle_seconds = 60;

  bool operator==(const SlurmConfig&) const = default;
};

void add_slurm_options(CLI::App& app, LauncherKind& launcher, SlurmConfig& config);

/// Throws InvalidInput when workers on nodes could not find the daemon, or would send images in the clear.
void require_usable(const SlurmConfig& config, const std::vector<ListenAddress>& protected_listen);

}  // namespace saltus::server
