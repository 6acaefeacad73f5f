#pragma once

namespace saltus {

/// Gives the calling thread the cores of all places, where the environment binds threads (OMP_PROC_BIND,
/// GOMP_CPU_AFFINITY): OpenMP's library has bound the first one to a single core, or place, before main, and what it
/// starts, threads or programs, would have no more. Changes nothing where threads are not bound.
/// @throws std::system_error when the kernel refuses these cores
void release_thread();

}  // namespace saltus
