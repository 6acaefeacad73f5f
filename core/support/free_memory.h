#pragma once

#include <vector>

namespace saltus {

/// Empties a vector and frees what it held. `values = {}` keeps that: it assigns no value to the room that there is.
template <class T>
void free_vector(std::vector<T>& values) {
  std::vector<T>().swap(values);
}

/// Gives the system what has been freed and is still the process's: between blocks that are in use, or kept for the
/// next one. Large blocks are made anew and take none of that.
void give_back_free_memory();

}  // namespace saltus
