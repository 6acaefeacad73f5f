#pragma once

namespace CLI {
class App;
}

namespace saltus::cli {

/// Exit codes of every program, as the command-line contract names them.
enum ExitCode { Done = 0, JobFailed = 1, Usage = 2, ServerNotReachable = 3, Cancelled = 4 };

/// Each command lives in its own pair of files and offers one function that adds its options to `app` and a callback
/// that does the work and stores the exit code:
///
///     void add_points_command(CLI::App& app, int& exit_code);
///
/// main.cpp lists them all. Callbacks may throw InvalidInput (exit code 2) and FileError (exit code 1).

}  // namespace saltus::cli
