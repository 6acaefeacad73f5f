#include "core/support/free_memory.h"

#include <malloc.h>

namespace saltus {

void give_back_free_memory() { malloc_trim(0); }

}  // namespace saltus
