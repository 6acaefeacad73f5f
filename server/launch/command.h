#pragma once

#include <chrono>
#include <functional>
#include <stop_token>
#include <string>
#include <vector>

namespace saltus::server {

/// A program to run to its end. No shell sees any of it.
struct Command {
  std::vector<std::string> arguments;  ///< the first is the program, looked for in PATH
  std::string input;                   ///< what it reads from standard input
};

struct CommandResult {
  enum class End { Exited, Signalled, TimedOut, Stopped, NotStarted } end = End::NotStarted;
  int code = 0;  ///< exit code, signal, or errno of a program that could not be started
  std::string output;
  std::string errors;  ///< of standard error

  bool is_good() const { return end == End::Exited && code == 0; }
};

/// One line for people: what the command said last, or how it ended.
std::string describe(const CommandResult& result);

/// Runs commands; tests give another one.
using CommandRunner = std::function<CommandResult(const Command&, std::chrono::milliseconds limit, std::stop_token)>;

/// Runs the command as a child in a process group of its own, which is killed when it takes longer than `limit` or
/// `stop` is requested. Of what it prints, the first 64 MiB and of its errors the first 64 KiB are kept. The variables
/// of the environment that would change what squeue and scancel do are taken away. Blocks.
CommandResult run_command(const Command& command, std::chrono::milliseconds limit, std::stop_token stop = {});

}  // namespace saltus::server
