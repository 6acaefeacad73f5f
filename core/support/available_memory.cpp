#include "core/support/available_memory.h"

#include "core/support/control_groups.h"

#include <algorithm>
#include <fstream>
#include <limits>
#include <string>

namespace saltus {
namespace fs = std::filesystem;
namespace {

constexpr std::int64_t kNoLimit = std::numeric_limits<std::int64_t>::max();

std::int64_t memory_of_machine(const fs::path& root) {
  std::ifstream lines(root / "proc/meminfo");
  std::int64_t kibibytes = 0;
  for (std::string name; lines >> name;)
    if (name == "MemTotal:") return lines >> kibibytes && kibibytes > 0 ? 1024 * kibibytes : kNoLimit;
  return kNoLimit;
}

/// "max", or more than there is, where there is none.
std::int64_t limit_of(const fs::path& file) {
  std::int64_t bytes = 0;
  std::ifstream limit(file);
  return limit >> bytes && bytes > 0 ? bytes : kNoLimit;
}

}  // namespace

std::int64_t available_memory(const fs::path& root) {
  std::int64_t bytes = memory_of_machine(root);
  for (const fs::path& group : control_groups_around("memory", root))
    // Of the first version; of the second, where beyond "high" processes are held up until they have hardly any time.
    for (const char* name : {"memory.limit_in_bytes", "memory.max", "memory.high"})
      bytes = std::min(bytes, limit_of(group / name));
  return bytes;
}

}  // namespace saltus
