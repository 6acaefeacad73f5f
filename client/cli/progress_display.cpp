#include "client/cli/progress_display.h"

#include "client/cli/job_output.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ostream>
#include <sstream>

#include <sys/ioctl.h>
#include <unistd.h>

namespace saltus::cli {
namespace {

constexpr int bar_cells = 20;

int terminal_columns() {
  winsize size{};
  return ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0 ? size.ws_col : 80;
}

bool is_running(const v1::RegistrationJob& job) {
  return job.state() == v1::JOB_STATE_RUNNING && job.progress().stage() == v1::JOB_STAGE_OPTIMISING;
}

/// Level, iteration and energy of the optimisation, or the stage, or the state: whatever says most.
std::string details(const v1::RegistrationJob& job) {
  const v1::JobProgress& progress = job.progress();
  std::ostringstream text;
  if (job.state() == v1::JOB_STATE_QUEUED) {
    text << "queued";
    if (job.queue_position() > 0) text << ", position " << job.queue_position();
  } else if (job.state() != v1::JOB_STATE_RUNNING) {
    std::string name = state_name(job.state());
    std::transform(name.begin(), name.end(), name.begin(), [](unsigned char c) { return std::tolower(c); });
    text << name;
  } else {
    text << stage_name(progress.stage());
    if (!progress.waiting_for().empty()) text << " for " << progress.waiting_for();
    if (is_running(job) && progress.levels() > 0) {
      text << ", level " << progress.level() << '/' << progress.levels() << ", iteration " << progress.iteration()
           << '/' << progress.max_iterations();
      // Until a level has its first value there is none to tell.
      if (progress.energy() != 0) text << ", energy " << progress.energy();
    }
  }
  return text.str();
}

long percent(const v1::RegistrationJob& job) {
  if (job.state() == v1::JOB_STATE_SUCCEEDED) return 100;
  return std::lround(100 * std::clamp(job.progress().fraction(), 0.0, 1.0));
}

}  // namespace

std::string format_seconds(double seconds) {
  if (!(seconds >= 0)) return "?";
  const long whole = std::lround(seconds);
  char text[32];
  if (whole < 60)
    std::snprintf(text, sizeof text, "%ld s", whole);
  else if (whole < 3600)
    std::snprintf(text, sizeof text, "%ld:%02ld min", whole / 60, whole % 60);
  else
    std::snprintf(text, sizeof text, "%ld:%02ld h", whole / 3600, whole / 60 % 60);
  return text;
}

std::string progress_line(const v1::RegistrationJob& job) {
  std::string text = details(job);
  if (is_running(job)) {
    text += ", " + std::to_string(percent(job)) + " %";
    if (job.progress().seconds_left() >= 0) text += ", " + format_seconds(job.progress().seconds_left()) + " left";
  }
  return text;
}

std::string progress_bar(const v1::RegistrationJob& job, int columns) {
  const long done = percent(job);
  const auto filled = static_cast<std::size_t>(bar_cells * done / 100);
  std::ostringstream text;
  text << '[' << std::string(filled, '#') << std::string(bar_cells - filled, '.') << "] ";
  text.width(3);
  text << done << " % " << details(job);
  if (is_running(job) && job.progress().seconds_left() >= 0)
    text << ", " << format_seconds(job.progress().seconds_left()) << " left";
  std::string bar = text.str();
  if (static_cast<int>(bar.size()) > columns) bar.resize(static_cast<std::size_t>(std::max(columns, 0)));
  return bar;
}

void ProgressDisplay::show(const v1::RegistrationJob& job, std::chrono::steady_clock::time_point now) {
  if (style_ == DisplayStyle::Bar) {
    // One column is left free: a full last column would wrap on some terminals.
    const int columns = terminal_columns() - 1;
    const std::string lead = lead_.substr(0, static_cast<std::size_t>(columns / 2));
    out_ << '\r' << lead << progress_bar(job, columns - static_cast<int>(lead.size())) << "\x1b[K" << std::flush;
    bar_is_open_ = true;
    return;
  }
  std::ostringstream phase;
  phase << job.state() << ' ' << job.progress().stage() << ' ' << job.progress().level();
  write_line(lead_ + progress_line(job), phase.str(), now);
}

void ProgressDisplay::show_text(const std::string& text, const std::string& phase,
                                std::chrono::steady_clock::time_point now) {
  if (style_ == DisplayStyle::Lines) return write_line(text, phase, now);
  out_ << '\r' << text.substr(0, static_cast<std::size_t>(terminal_columns() - 1)) << "\x1b[K" << std::flush;
  bar_is_open_ = true;
}

void ProgressDisplay::write_line(const std::string& line, const std::string& phase,
                                 std::chrono::steady_clock::time_point now) {
  if (line == last_line_ || (phase == last_phase_ && now - last_time_ < std::chrono::seconds(1))) return;
  out_ << line << std::endl;
  last_line_ = line;
  last_phase_ = phase;
  last_time_ = now;
}

void ProgressDisplay::finish() {
  if (bar_is_open_) out_ << std::endl;
  bar_is_open_ = false;
}

DisplayStyle display_style_of_stderr() { return isatty(STDERR_FILENO) ? DisplayStyle::Bar : DisplayStyle::Lines; }

}  // namespace saltus::cli
