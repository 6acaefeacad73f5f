#include "server/launch/memory_kills.h"

#include <fstream>
#include <sstream>
#include <string>
#include <vector>

namespace saltus::server {
namespace fs = std::filesystem;
namespace {

std::optional<std::int64_t> oom_kill_of(const fs::path& file) {
  std::ifstream lines(file);
  std::string name;
  std::int64_t count = 0;
  while (lines >> name >> count)
    if (name == "oom_kill") return count;
  return std::nullopt;
}

}  // namespace

std::optional<std::int64_t> memory_kills(const fs::path& root) {
  const fs::path groups = root / "sys/fs/cgroup";
  std::ifstream lines(root / "proc/self/cgroup");
  std::vector<fs::path> files;
  // "4:memory:/system.slice/x" of the first version, "0::/system.slice/x" of the second.
  for (std::string line; std::getline(lines, line);) {
    std::istringstream parts(line);
    std::string number, controllers, path;
    if (!std::getline(parts, number, ':') || !std::getline(parts, controllers, ':') || !std::getline(parts, path))
      continue;
    const fs::path group = fs::path(path).relative_path();
    if (controllers == "memory") files.push_back(groups / "memory" / group / "memory.oom_control");
    if (controllers.empty()) files.push_back(groups / group / "memory.events");
  }
  for (const fs::path& file : files)
    if (const auto count = oom_kill_of(file)) return count;
  return std::nullopt;
}

}  // namespace saltus::server
