#include "server/launch/process_identity.h"

#include <fstream>
#include <sstream>

namespace saltus::server {

std::string ProcessIdentity::to_text() const { return std::to_string(pid) + " " + start_time + " " + boot; }

std::optional<ProcessIdentity> identify(pid_t pid) {
  std::ifstream file("/proc/" + std::to_string(pid) + "/stat");
  std::string line;
  if (!std::getline(file, line)) return std::nullopt;
  // The second field, the program's name in brackets, may itself hold spaces and brackets.
  const auto bracket = line.rfind(')');
  if (bracket == std::string::npos) return std::nullopt;
  std::istringstream fields(line.substr(bracket + 1));
  std::string state, start_time;
  fields >> state;
  for (int field = 4; field <= 22; ++field) fields >> start_time;
  if (!fields || state == "Z" || state == "X") return std::nullopt;
  ProcessIdentity identity{pid, start_time, ""};
  std::ifstream("/proc/sys/kernel/random/boot_id") >> identity.boot;
  return identity;
}

std::optional<ProcessIdentity> parse_identity(const std::string& text) {
  std::istringstream fields(text);
  ProcessIdentity identity;
  if (!(fields >> identity.pid >> identity.start_time >> identity.boot) || identity.pid <= 1) return std::nullopt;
  return identity;
}

}  // namespace saltus::server
