#pragma once

#include <chrono>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <sys/types.h>

namespace saltus::testing_support {

/// A program that runs as a child of the test, standard output and error read through pipes, standard input empty.
/// Whoever is still running when the object goes is killed (by its id) and waited for.
///
/// Every wait has a limit, after which std::runtime_error with the output so far is thrown: a test then fails instead
/// of hanging.
class ChildProcess {
 public:
  explicit ChildProcess(const std::vector<std::string>& command,
                        const std::map<std::string, std::string>& environment = {});
  ~ChildProcess();
  ChildProcess(ChildProcess&& other) noexcept;
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  pid_t id() const { return id_; }
  void signal(int number) const;

  /// Waits until `text` stands in what the child has written to either stream; returns the line it stands in.
  std::string wait_for_output(const std::string& text);
  /// Waits for the end; the exit code, or 128 + the signal that ended it.
  int wait();

  const std::string& out() const { return out_; }
  const std::string& err() const { return err_; }

  /// The processes that this one has started and that still run.
  std::vector<pid_t> children() const;

  static constexpr std::chrono::seconds patience{120};

 private:
  /// Reads what there is; false when both streams are at their end.
  bool read_more(std::chrono::steady_clock::time_point until);

  pid_t id_ = -1;
  int out_end_ = -1, err_end_ = -1;
  std::optional<int> exit_code_;
  std::string out_, err_;
};

/// A running process that is not necessarily a child, held so that its id cannot be another's.
class ProcessHandle {
 public:
  explicit ProcessHandle(pid_t id);
  ~ProcessHandle();
  ProcessHandle(ProcessHandle&& other) noexcept;
  ProcessHandle(const ProcessHandle&) = delete;
  ProcessHandle& operator=(const ProcessHandle&) = delete;

  /// True when the process ends within `time`.
  bool ends_within(std::chrono::milliseconds time) const;

 private:
  int descriptor_;
};

}  // namespace saltus::testing_support
