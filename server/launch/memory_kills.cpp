#include "server/launch/memory_kills.h"

#include "core/support/control_groups.h"

#include <fstream>
#include <string>

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
  for (const fs::path& group : control_groups("memory", root))
    for (const char* name : {"memory.oom_control", "memory.events"})  // of the first version and of the second
      if (const auto count = oom_kill_of(group / name)) return count;
  return std::nullopt;
}

}  // namespace saltus::server
