#pragma once

#include <vector>

namespace saltus {

/// Cores of all places that the environment binds threads to (OMP_PROC_BIND, OMP_PLACES, GOMP_CPU_AFFINITY), rising;
/// none where threads are not bound.
std::vector<int> cores_of_places();

/// Gives the calling thread all cores of the places. OpenMP's library has bound the first thread to one of them before
/// main, and what that starts, threads or programs, would have no more. Nothing changes where threads are not bound,
/// and where the kernel lets the process use none of these cores.
void release_thread();

}  // namespace saltus
