#pragma once

#include "tests/benchmark/service_load/figures.h"

#include <filesystem>
#include <vector>

namespace saltus::benchmark {

struct LoadOptions {
  std::filesystem::path daemon;
  std::filesystem::path self;  ///< this program, which is also the worker and the pinger
  int queued = 10000;
  int watchers = 200;
  int uploads = 16;
  int upload_mebibytes = 8;
  int seconds = 60;
  int rows = 100000;
  bool is_judged = true;  ///< the figures have targets
};

/// Starts a daemon, loads it, kills and restarts it, and stops it; tells on standard error what it is at.
///
/// Everything, clients, worker and pinger too, runs on this machine and shares its cores.
std::vector<Figure> run_load(const LoadOptions& options);

}  // namespace saltus::benchmark
