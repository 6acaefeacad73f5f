#pragma once

#include <filesystem>
#include <stop_token>
#include <string>
#include <vector>

namespace saltus::worker {

/// One attempt, for a process of its own.
struct AttemptOrder {
  std::string job_id;
  int attempt = 0;
  /// Either the launch token, or a file that holds it.
  std::string token, token_file;
  std::vector<std::string> options;  ///< where the daemon is
  int threads = 0;  ///< above 0: the environment is made for so many, as the daemon does for workers that it launches
};

/// How the process of an attempt ended.
struct ProcessEnd {
  bool is_signalled = false;
  int number = 0;  ///< exit code, or signal
};

/// Runs the attempt in a child: this program again, in a process group of its own and with a folder for temporary files
/// that goes with it, whatever way it ends. A token is handed over in a file of mode 0600 in there. When `stop` is
/// requested the child gets SIGTERM and is waited for. Throws FileError, std::system_error.
ProcessEnd run_attempt_process(const AttemptOrder& order, const std::stop_token& stop);

/// Ends this process as that one has ended.
[[noreturn]] void end_like(const ProcessEnd& end);

}  // namespace saltus::worker
