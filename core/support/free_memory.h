#pragma once

namespace saltus {

/// Gives the system what has been freed and is still the process's: between blocks that are in use, or because the next
/// one may want it. Blocks that are larger than all before take none of that.
void give_back_free_memory();

}  // namespace saltus
