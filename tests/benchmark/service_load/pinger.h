#pragma once

#include <string>
#include <vector>

namespace saltus::benchmark {

/// In milliseconds.
struct Pings {
  std::vector<double> times;     ///< from sending to the answer
  std::vector<double> lateness;  ///< how much later than it was due each one was sent: what the machine alone takes
};

/// Calls GetServerInfo every 10 ms, whether or not the calls before have been answered, so that a pause of the daemon
/// counts in full. Throws std::runtime_error when a call fails.
Pings ping(const std::string& address, double seconds);

/// For a pinger in a process of its own, so that it does not stand in line with the other clients of this program.
std::string to_text(const Pings& pings);
Pings parse_pings(const std::string& text);

}  // namespace saltus::benchmark
