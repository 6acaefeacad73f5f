#pragma once

#include "tests/benchmark/service_load/figures.h"

#include <filesystem>
#include <vector>

namespace saltus::benchmark {

struct WorkersOptions {
  std::filesystem::path daemon;
  int workers = 64;
  int jobs = 5000;
  int artifact_kibibytes = 64;       ///< what a job makes
  int heartbeats_per_second = 2000;  ///< of all workers together, while heartbeats are measured
  int seconds = 20;                  ///< how long they are
};

/// Starts a daemon that runs no workers itself, and so many that come by themselves: threads with a connection each and
/// a solver that takes no time. Every job is taken, fetched, heard of, delivered and completed as a worker does it;
/// what is left is what the daemon costs. Everything is on this machine and shares its cores.
std::vector<Figure> run_many_workers(const WorkersOptions& options);

}  // namespace saltus::benchmark
