#pragma once

#include <filesystem>

namespace saltus {

/// How many cores this process can keep busy, one at least: those that it may run on (its affinity, which Slurm,
/// `taskset` and containers with cores of their own set; where threads are bound, those of their places), and no more
/// than its control group, or one around it, may use in the mean (the CPU quota of a container, rounded down: with a
/// thread more all of them would be held up). `root`: of the kernel's files, where the quota is looked for.
int available_cores(const std::filesystem::path& root = "/");

}  // namespace saltus
