#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace saltus {

/// The values of the elements `wanted`, from those that `theirs` has; both rise. Others stay what they are.
template <int Dim, class T>
void pick_elements(const std::vector<std::uint32_t>& theirs, const T* from, const std::vector<std::uint32_t>& wanted,
                   T* to) {
  for (std::size_t e = 0, k = 0; e < wanted.size(); ++e) {
    while (k < theirs.size() && theirs[k] < wanted[e]) ++k;
    if (k < theirs.size() && theirs[k] == wanted[e]) std::copy_n(from + (Dim - 1) * k, Dim - 1, to + (Dim - 1) * e);
  }
}

}  // namespace saltus
