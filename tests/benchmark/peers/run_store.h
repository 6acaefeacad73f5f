#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tests/benchmark/table.h"

namespace saltus::benchmark {

/// One measured run: a pair, a method, a number of threads, and all that decides what comes out.
struct PeerRun {
  std::string scene, pair, family, choice;
  int threads = 1;
  std::string setting;
  Row row;  ///< outcome, complaints and figures

  std::string method() const { return choice.empty() ? family : family + " " + choice; }
};

/// Runs in a file, which is replaced as a whole after each new one, so that what was measured is never lost.
class RunStore {
 public:
  /// Reads what is there. Throws std::runtime_error that names the file when it is no such file.
  explicit RunStore(std::filesystem::path file);

  const std::vector<PeerRun>& runs() const { return runs_; }

  /// The run of this pair, method and number of threads, when it was of the same setting and gave figures.
  const PeerRun* find(const PeerRun& wanted) const;

  /// In the place of an earlier one of the same pair, method and number of threads. Throws std::runtime_error when the
  /// file cannot be written.
  void put(PeerRun run);

 private:
  std::filesystem::path file_;
  std::vector<PeerRun> runs_;
};

}  // namespace saltus::benchmark
