#pragma once

#include "saltus/v1/registration.pb.h"

#include <chrono>
#include <iosfwd>
#include <string>

namespace saltus::cli {

/// "45 s", "3:07 min", "2:05 h"; "?" while unknown (negative).
std::string format_seconds(double seconds);

/// Where the job stands, in words: "optimising, level 2/3, iteration 12/60, energy 123.4, 45 %, 12 s left".
std::string progress_line(const v1::RegistrationJob& job);

/// The same behind a bar: "[#####.....]  45 % level 2/3 ...", at most `columns` wide.
std::string progress_bar(const v1::RegistrationJob& job, int columns);

enum class DisplayStyle { Bar, Lines };

/// Shows the states of one job as they come: a bar that is drawn over itself, or plain lines, at most one a second
/// unless stage, level or state changed. Not thread-safe.
class ProgressDisplay {
 public:
  ProgressDisplay(std::ostream& out, DisplayStyle style) : out_(out), style_(style) {}
  ~ProgressDisplay() { finish(); }

  void show(const v1::RegistrationJob& job,
            std::chrono::steady_clock::time_point now = std::chrono::steady_clock::now());
  /// The same of several jobs, which the caller puts in words; `phase` says what is new enough not to wait a second.
  void show_text(const std::string& text, const std::string& phase,
                 std::chrono::steady_clock::time_point now = std::chrono::steady_clock::now());
  /// Stands before what is shown from now on.
  void lead(std::string text) { lead_ = std::move(text); }
  /// Ends the bar's line; nothing for plain lines.
  void finish();

 private:
  void write_line(const std::string& line, const std::string& phase, std::chrono::steady_clock::time_point now);

  std::ostream& out_;
  DisplayStyle style_;
  std::string lead_;
  bool bar_is_open_ = false;
  std::string last_phase_;
  std::string last_line_;
  std::chrono::steady_clock::time_point last_time_;
};

/// A bar when standard error is a terminal, else lines.
DisplayStyle display_style_of_stderr();

}  // namespace saltus::cli
