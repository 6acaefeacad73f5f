#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace saltus::benchmark {

/// What a program has used from its start to its end, with all that it has started and waited for.
struct ProcessCost {
  int exit_code = 0;       ///< 128 + the signal for one that a signal has ended
  double cpu_seconds = 0;  ///< of the user and of the system
  double wall_seconds = 0;
  double peak_megabytes = 0;  ///< of the largest of its processes (MiB); not less than this process has now
};

/// Runs `command` (a program, found as a shell would, and its arguments) to its end in the present folder. What it
/// writes goes to the file `log`, what it reads is empty. `environment` is added to that of this process. Throws
/// std::runtime_error when it cannot be started.
ProcessCost run_measured(const std::vector<std::string>& command, const std::map<std::string, std::string>& environment,
                         const std::filesystem::path& log);

/// The program called `name` in the folders of PATH; empty when there is none.
std::filesystem::path find_program(const std::string& name);

}  // namespace saltus::benchmark
