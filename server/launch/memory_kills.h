#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

namespace saltus::server {

/// How many processes of this process' control group the kernel has ended because there was no memory left for them,
/// the group's or the machine's; nothing where no such number can be had. `root`: for the files that the kernel makes.
std::optional<std::int64_t> memory_kills(const std::filesystem::path& root = "/");

}  // namespace saltus::server
