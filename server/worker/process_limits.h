#pragma once

#include <cstdint>

namespace saltus::worker {

/// What this process uses.
struct ProcessUse {
  std::int64_t memory_bytes = 0;  ///< resident
  double cpu_seconds = 0;         ///< of all threads together
};
ProcessUse process_use();

/// No core files, which would hold a patient's images; few open files; and when the machine runs out of memory, this
/// process goes before the daemon does.
void prepare_process();

/// Limits of the kernel for this process; 0: none.
///
/// Memory: RLIMIT_DATA, counted from what the process has now, with room for the stacks of `threads` threads and the
/// network's. It counts what the process may write, while RLIMIT_AS would also count libraries and what allocators set
/// aside for each thread and never touch, gigabytes that cost nothing. Beyond it `new` throws std::bad_alloc. A reserve
/// is kept for telling the daemon, see release_reserve.
///
/// CPU time: RLIMIT_CPU. Beyond it cpu_time_is_used_up() is true; a minute later the kernel ends the process.
void limit_process(std::int64_t memory_bytes, double cpu_seconds, int threads);

/// Lets the process use the memory that was kept back for its last words. May be called from any thread.
void release_reserve();

/// What stands in the way of the work is a lack of memory: releases the reserve, and memory_is_used_up() is true.
void note_memory_is_used_up();
bool memory_is_used_up();

/// From now on an abort() ends the process with `exit_code` when there is no memory left: C libraries, gRPC's among
/// them, know no other way when malloc fails. Any other abort stays one.
void exit_when_out_of_memory(int exit_code);

bool cpu_time_is_used_up();

}  // namespace saltus::worker
