#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace saltus {

/// Where the kernel may tell of the control group that this process is in, for one controller ("cpu", "memory"):
/// folders of the first version of control groups and of the second, as this process' own list names them, whether they
/// are there or not. `root`: of the kernel's files.
std::vector<std::filesystem::path> control_groups(const std::string& controller,
                                                  const std::filesystem::path& root = "/");

/// The same with all groups around those, up to what a container that sees its own group as the whole has.
std::vector<std::filesystem::path> control_groups_around(const std::string& controller,
                                                         const std::filesystem::path& root = "/");

}  // namespace saltus
