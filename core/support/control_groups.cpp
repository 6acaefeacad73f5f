#include "core/support/control_groups.h"

#include <fstream>
#include <sstream>

namespace saltus {
namespace fs = std::filesystem;

std::vector<fs::path> control_groups(const std::string& controller, const fs::path& root) {
  const fs::path groups = root / "sys/fs/cgroup";
  std::ifstream lines(root / "proc/self/cgroup");
  std::vector<fs::path> folders;
  // "4:cpu,cpuacct:/system.slice/x" of the first version, "0::/system.slice/x" of the second.
  for (std::string line; std::getline(lines, line);) {
    std::istringstream parts(line);
    std::string number, controllers, path;
    if (!std::getline(parts, number, ':') || !std::getline(parts, controllers, ':') || !std::getline(parts, path))
      continue;
    const fs::path group = fs::path(path).relative_path();
    if (controllers.empty()) folders.push_back(groups / group);
    std::istringstream names(controllers);
    for (std::string name; std::getline(names, name, ',');)
      if (name == controller) {
        folders.push_back(groups / controllers / group);
        // The folder may have its controllers in another order, and a link for each of them.
        if (controllers != controller) folders.push_back(groups / controller / group);
      }
  }
  return folders;
}

std::vector<fs::path> control_groups_around(const std::string& controller, const fs::path& root) {
  const fs::path top = root / "sys/fs/cgroup";
  std::vector<fs::path> folders;
  for (fs::path group : control_groups(controller, root))
    for (; group != top && group.has_relative_path(); group = group.parent_path()) folders.push_back(group);
  folders.push_back(top);
  return folders;
}

}  // namespace saltus
