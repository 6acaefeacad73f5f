#pragma once

#include <cstdint>
#include <filesystem>

namespace saltus {

/// Bytes that this process and others can have in all: those of the machine, and no more than the control group that it
/// is in, or one around it, may have (the memory limit of a container or of a Slurm job). The largest number there is
/// where the kernel tells neither. `root`: of the kernel's files.
std::int64_t available_memory(const std::filesystem::path& root = "/");

}  // namespace saltus
