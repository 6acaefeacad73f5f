#pragma once

#include <sys/types.h>

#include <optional>
#include <string>

namespace saltus::server {

/// Names a process beyond the reuse of its number: number, start time, and the boot of the machine.
struct ProcessIdentity {
  pid_t pid = 0;
  std::string start_time;  ///< in clock ticks since the boot, as /proc gives it
  std::string boot;

  std::string to_text() const;
  bool operator==(const ProcessIdentity&) const = default;
};

/// Nothing when no such process runs; one that has ended but was not reaped does not run.
std::optional<ProcessIdentity> identify(pid_t pid);
/// The inverse of to_text; nothing for anything else.
std::optional<ProcessIdentity> parse_identity(const std::string& text);

}  // namespace saltus::server
