#pragma once

namespace saltus {

/// Gives the system what has been freed and is still the process's: between blocks that are in use, or kept for the
/// next one. Large blocks are made anew and take none of that.
void give_back_free_memory();

}  // namespace saltus
