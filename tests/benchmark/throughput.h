#pragma once

#include <filesystem>
#include <iosfwd>
#include <string>
#include <vector>

#include "tests/benchmark/table.h"

namespace saltus::benchmark {

struct ThroughputOptions {
  std::filesystem::path programs;  ///< folder of saltus, saltusd and saltus-worker
  std::filesystem::path out;       ///< for images, results and what the programs say
  int pairs = 8;                   ///< at least as many as jobs at the same time
  int size = 96;                   ///< voxels across the thorax
  std::vector<std::string>
      settings;  ///< "JOBSxTHREADS"; none: all that fill the cores, and one that takes twice as many
};

/// Registers the same pairs by a daemon of its own for each division of the machine into jobs and threads: wall time of
/// them all, processor time of daemon and workers, and how much of the machine others took meanwhile, without which no
/// wall time could be compared. Throws std::runtime_error when a program fails.
std::vector<Row> throughput_rows(const ThroughputOptions& options, std::ostream& progress);
std::vector<Column> throughput_columns();

}  // namespace saltus::benchmark
