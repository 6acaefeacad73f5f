#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <string>

namespace saltus::server {

/// Writes lines to a descriptor from a thread of its own, so that whoever has something to say never waits for whoever
/// should read it. Lines that come while so many others wait are dropped and counted; how many is written where they
/// are missing.
///
/// A write to a pipe that nobody reads cannot be ended: the thread then stays behind when this object goes, and ends
/// with the process. The descriptor must stay open until then. Thread-safe.
class LineWriter {
 public:
  struct Limits {
    std::size_t waiting = 10000;               ///< lines
    std::chrono::milliseconds farewell{1000};  ///< how long destruction waits for lines to be taken
  };
  /// `lost_line` makes the line that says how many others are missing, with its end.
  LineWriter(int descriptor, std::function<std::string(std::uint64_t lost)> lost_line, Limits limits);
  /// Waits a moment for what was added.
  ~LineWriter();
  LineWriter(const LineWriter&) = delete;
  LineWriter& operator=(const LineWriter&) = delete;

  /// `line` with its end. Never blocks.
  void add(std::string line);
  /// How many lines were dropped so far.
  std::uint64_t dropped() const;

 private:
  struct State {
    const int descriptor;
    const std::function<std::string(std::uint64_t)> lost_line;
    const Limits limits;
    std::mutex mutex;
    std::condition_variable changed;
    std::deque<std::string> waiting;
    std::uint64_t lost = 0;  ///< and not yet said
    std::uint64_t dropped = 0;
    bool is_writing = false;
    bool is_closing = false;
  };
  static void run(const std::shared_ptr<State>& state);

  const std::shared_ptr<State> state_;  // the thread's too
};

}  // namespace saltus::server
